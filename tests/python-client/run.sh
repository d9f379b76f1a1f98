#!/usr/bin/env bash
# The Python client: types, style, and every call on the daemon itself.
#
#   tests/python-client/run.sh [what pytest takes]
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

python_environment python-client
bin=$root/target/python-client/bin
# As a user has it, from a wheel; what it depends on is there already, at the versions pinned.
"$bin/pip" install --quiet --disable-pip-version-check --no-build-isolation --no-deps --force-reinstall \
  "$root/clients/python"
"$bin/pip" check --disable-pip-version-check >/dev/null
build_daemon
for folder in . "$root/clients/python"; do
  "$bin/ruff" check --quiet --no-cache "$folder"
  "$bin/ruff" format --quiet --check --no-cache "$folder"
done
mypy=("$bin/mypy" --no-error-summary --cache-dir "$root/target/python-client/mypy" --config-file "$root/clients/python/pyproject.toml")
(cd "$root/clients/python" && "${mypy[@]}")
"${mypy[@]}" ./*.py
exec env PYTHONDONTWRITEBYTECODE=1 "$bin/pytest" -p no:cacheprovider --quiet --timeout 300 --durations 5 "$@"
