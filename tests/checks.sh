#!/usr/bin/env bash
# Every check, with each part's time: format, clippy, tests, docs, page.
set -euo pipefail
cd "$(dirname "$0")/.."

times=()
part() {
  local name=$1 start=$SECONDS
  shift
  echo "== $name"
  if ! "$@"; then
    echo "== $name FAILED after $((SECONDS - start)) s" >&2
    exit 1
  fi
  times+=("$(printf '%6d s  %s' $((SECONDS - start)) "$name")")
}

page() { (cd web && npm run --silent check && npm test --silent); }
# The hardware tests are a target that "all" does not take in.
lints() {
  cargo clippy --quiet --all-targets -- -D warnings &&
    cargo clippy --quiet --test hardware -- -D warnings
}
browser() { (cd web && npm run --silent e2e); }
docs() { RUSTDOCFLAGS="-D warnings" cargo doc --quiet --no-deps --document-private-items; }

part "set-up" deploy/setup.sh test
part "format" cargo fmt --check
part "page built" make --no-print-directory web
part "page checked" page
part "clippy" lints
part "tests" cargo test --quiet
part "docs" docs
part "vendors' clients" tests/vendor-clients/run.sh
part "websocket clients" tests/ws-clients/run.sh
part "python client" tests/python-client/run.sh
part "walk with curl" tests/curl-walk/run.sh
part "Alpaca client" tests/alpaca-client/run.sh
part "recordings" tests/mcap-client/run.sh
part "foxglove" tests/foxglove/run.sh
# The same examples in every run; `make test-long` takes new ones.
part "schemathesis" env SEED="${SEED:-1}" tests/schemathesis/run.sh
part "promtool" tests/promtool.sh
part "announcement" tests/mdns/run.sh
part "page in a browser" browser

echo "== all checks passed in $SECONDS s"
printf '%s\n' "${times[@]}"
