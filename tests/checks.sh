#!/usr/bin/env bash
# Every check, with each part's time: format, lints, tests, docs, page, and other people's clients.
#
# Parts that mostly wait (for a daemon, a browser, a bench that moves) run beside those that compute, so that neither
# core stands idle: what a part prints is shown whole, once it has ended.
set -euo pipefail
cd "$(dirname "$0")/.."

logs=$(mktemp -d)
lane_pids=()
finish() {
  # Whatever still runs beside a part that has failed, with all that it started.
  for pid in "${lane_pids[@]}"; do
    kill -TERM -- "-$pid" 2>/dev/null || true
  done
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

# What runs beside the rest: `beside LANE NAME COMMAND...`. The parts of one lane run one after another in the order of the
# calls, and lanes beside one another.
parts=()
beside() { parts+=("$(printf '%q ' "$@")"); }
run_lane() {
  local lane=$1 number start
  for number in "${!parts[@]}"; do
    eval "set -- ${parts[number]}"
    [[ $1 == "$lane" ]] || continue
    start=$SECONDS
    if ! "${@:3}" >"$logs/$number" 2>&1 </dev/null; then
      echo $((SECONDS - start)) >"$logs/$number.failed"
      return 1
    fi
    echo $((SECONDS - start)) >"$logs/$number.done"
  done
}
start_lanes() {
  local lane
  # With job control a lane is a process group, which can be ended as one.
  set -m
  for lane in "$@"; do
    run_lane "$lane" &
    lane_pids+=($!)
  done
  set +m
}
# Waits for the lanes' ends, and shows what their parts printed.
join_lanes() {
  local pid number status=0 failed="" printed=""
  for pid in "${lane_pids[@]}"; do
    wait "$pid" || status=$?
  done
  lane_pids=()
  for number in "${!parts[@]}"; do
    [[ -e $logs/$number ]] || continue
    eval "set -- ${parts[number]}"
    echo "== $2"
    cat "$logs/$number"
    if [[ -e $logs/$number.done ]]; then
      times+=("$(printf '%6d s  %s (beside)' "$(<"$logs/$number.done")" "$2")")
    elif [[ -e $logs/$number.failed ]]; then
      failed+="${failed:+, }$2 after $(<"$logs/$number.failed") s"
      # Where only a log's end is kept, it says why.
      printed+="== the last that $2 printed"$'\n'"$(tail -n 25 "$logs/$number")"$'\n'
    fi
  done
  if ((status != 0)); then
    printf '%s== FAILED: %s\n' "$printed" "${failed:-a lane}" >&2
    exit 1
  fi
  parts=()
  rm -f "$logs"/*
}

page() { make --no-print-directory web && (cd web && npm run --silent check && npm test --silent); }
# The hardware tests are a target that "all" does not take in. Where the time went is in target/cargo-timings.
built_and_linted() {
  cargo test --quiet --no-run --all-targets --timings && cargo test --quiet --no-run --test hardware
}
browser() { (cd web && npm run --silent e2e); }
docs() { RUSTDOC=$PWD/tests/rustdoc.sh cargo test --quiet --doc; }

part "set-up" deploy/setup.sh test
part "format" cargo fmt --check
. tests/lints.sh
beside page "page built and checked" page
start_lanes page
part "tests built and linted" built_and_linted
join_lanes

# The program is there, and nothing else is built beside the tests.
export NO_BUILD=1
beside page "page in a browser" browser
beside page "documentation" tests/docs/run.sh
beside page "MQTT" tests/mqtt/run.sh
beside page "metrics, dashboards, alerts" tests/promtool.sh
beside page "foxglove" tests/foxglove/run.sh
beside clients "Python client" tests/python-client/run.sh
# The same examples in every run; `make test-long` takes new ones.
beside clients "schemathesis" env SEED="${SEED:-1}" tests/schemathesis/run.sh
beside clients "vendors' clients" tests/vendor-clients/run.sh
beside clients "Alpaca client" tests/alpaca-client/run.sh
beside clients "GenICam camera" tests/genicam/run.sh
beside clients "simulated GenICam camera" tests/genicam/twin.sh
beside clients "recordings" tests/mcap-client/run.sh
beside clients "websocket clients" tests/ws-clients/run.sh
beside clients "announcement" tests/mdns/run.sh
beside clients "batch files" tests/batch/run.sh
start_lanes page clients
# One more than there are cores: half of a test's time is waiting.
part "tests" env RUST_TEST_THREADS=$(($(nproc) + 1)) cargo test --quiet --tests
part "docs" docs
join_lanes

echo "== all checks passed in $SECONDS s"
printf '%s\n' "${times[@]}"
