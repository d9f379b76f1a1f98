#!/usr/bin/env bash
# The contract tried on the daemon by Schemathesis: every check, on single requests and on sequences of them that build
# on one another.
#
#   tests/schemathesis/run.sh                  a few examples of each operation
#   EXAMPLES=200 tests/schemathesis/run.sh     many
#   SEED=17 tests/schemathesis/run.sh          those of another run again
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

python_environment schemathesis
build_daemon
start_daemon
status=0
"$root/target/schemathesis/bin/schemathesis" --config-file schemathesis.toml run "$root/proto/openapi.json" \
  --url "$ADDRESS" --max-examples "${EXAMPLES:-5}" ${SEED:+--seed "$SEED"} || status=$?
if ((status != 0)); then
  tail -n 20 "$DAEMON_LOG" >&2
fi
exit "$status"
