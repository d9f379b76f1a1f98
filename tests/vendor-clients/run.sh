#!/usr/bin/env bash
# The controller twins checked by the vendors' own clients, in a Python environment of their own: if a twin speaks the
# protocol well enough for them, it is worth testing our drivers against.
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

python_environment vendor-clients
venv=$root/target/vendor-clients
build_daemon
failed=0
for client in zaber pi tmcl thorlabs-rack thorlabs-cube; do
  script=${client%%-*}.py arguments=()
  config=() only=()
  case $client in
  thorlabs-rack)
    arguments=(rack) config=(--config "$root/deploy/examples/thorlabs.toml")
    ;;
  thorlabs-cube)
    arguments=(cube) config=(--config "$root/deploy/examples/thorlabs-kcubes.toml") only=(--controller lens)
    ;;
  esac
  log=$(mktemp)
  # Quick axes, so that it takes seconds: both at 20 mm/s.
  "$root/target/debug/plenalign" "${config[@]}" sim-stage --json --protocol "${client%%-*}" "${only[@]}" \
    --set bench.focus.speed_mm_per_s=20 --set bench.focus.acceleration_mm_per_s2=200 \
    --set bench.e.speed_mm_per_s=20 --set bench.e.acceleration_mm_per_s2=200 >"$log" &
  twin=$!
  wait_for says_or_ended "$log" "$twin" || true
  port=$(sed -n 's/.*"port":"\([^"]*\)".*/\1/p' "$log")
  if [[ -z $port ]]; then
    echo "vendor clients: the $client twin did not start" >&2
    failed=1
  elif ! timeout 120 "$venv/bin/python" "$script" "${arguments[@]}" "$port"; then
    echo "vendor clients: $client FAILED" >&2
    failed=1
  fi
  kill -INT "$twin" 2>/dev/null || true
  wait "$twin" 2>/dev/null || true
  rm -f "$log"
done
exit "$failed"
