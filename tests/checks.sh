#!/usr/bin/env bash
# Every check, with each part's time: format, clippy, tests, docs, page, and other people's clients.
#
# Parts that mostly wait (for a daemon, a browser, a bench that moves) run beside those that compute, so that neither
# core stands idle: what a part prints is shown whole, once it has ended.
set -euo pipefail
cd "$(dirname "$0")/.."

logs=$(mktemp -d)
lane_pid=
finish() {
  # Whatever still runs beside a part that has failed, with all that it started.
  [[ -z $lane_pid ]] || kill -TERM -- "-$lane_pid" 2>/dev/null || true
  rm -rf "$logs"
}
trap finish EXIT
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

# What runs beside the rest, started by `beside NAME COMMAND...` one after another in the order of the calls.
lane=()
beside() { lane+=("$(printf '%q ' "$@")"); }
run_lane() {
  local entry start number=0
  for entry in "${lane[@]}"; do
    eval "set -- $entry"
    start=$SECONDS
    if ! "${@:2}" >"$logs/$number" 2>&1 </dev/null; then
      printf '%d\t%s\n' $((SECONDS - start)) "$1" >"$logs/failed"
      return 1
    fi
    printf '%d\t%s\n' $((SECONDS - start)) "$1" >"$logs/$number.done"
    number=$((number + 1))
  done
}
start_lane() {
  # With job control the lane is a process group, which can be ended as one.
  set -m
  run_lane &
  lane_pid=$!
  set +m
}
# Waits for the lane's end, and shows what its parts printed.
join_lane() {
  local status=0 number seconds name
  wait "$lane_pid" || status=$?
  lane_pid=
  for ((number = 0; number < ${#lane[@]}; number++)); do
    [[ -e $logs/$number ]] || break
    eval "set -- ${lane[number]}"
    echo "== $1"
    cat "$logs/$number"
    if [[ -e $logs/$number.done ]]; then
      IFS=$'\t' read -r seconds name <"$logs/$number.done"
      times+=("$(printf '%6d s  %s (beside)' "$seconds" "$name")")
    fi
  done
  if ((status != 0)); then
    IFS=$'\t' read -r seconds name <"$logs/failed"
    echo "== $name FAILED after $seconds s" >&2
    exit 1
  fi
  lane=()
  rm -f "$logs"/*
}

page() { make --no-print-directory web && (cd web && npm run --silent check && npm test --silent); }
# The hardware tests are a target that "all" does not take in.
lints() {
  cargo clippy --quiet --all-targets -- -D warnings &&
    cargo clippy --quiet --test hardware -- -D warnings
}
browser() { (cd web && npm run --silent e2e); }
docs() { RUSTDOCFLAGS="-D warnings" cargo doc --quiet --no-deps --document-private-items; }

part "set-up" deploy/setup.sh test
part "format" cargo fmt --check
beside "page built and checked" page
start_lane
part "clippy" lints
join_lane
part "tests built" cargo test --quiet --no-run

beside "page in a browser" browser
beside "python client" tests/python-client/run.sh
beside "recordings" tests/mcap-client/run.sh
# The same examples in every run; `make test-long` takes new ones.
beside "schemathesis" env SEED="${SEED:-1}" tests/schemathesis/run.sh
beside "Alpaca client" tests/alpaca-client/run.sh
beside "documentation" tests/docs/run.sh
beside "vendors' clients" tests/vendor-clients/run.sh
beside "websocket clients" tests/ws-clients/run.sh
beside "foxglove" tests/foxglove/run.sh
beside "metrics, dashboards, alerts" tests/promtool.sh
beside "batch files" tests/batch/run.sh
beside "announcement" tests/mdns/run.sh
beside "MQTT" tests/mqtt/run.sh
start_lane
part "tests" cargo test --quiet
part "docs" docs
join_lane

echo "== all checks passed in $SECONDS s"
printf '%s\n' "${times[@]}"
