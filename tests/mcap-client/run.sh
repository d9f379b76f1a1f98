#!/usr/bin/env bash
# A recording of the real program as another's reader sees it: Python's mcap and mcap-protobuf-support, which know of the
# messages only what the file itself says.
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

python_environment mcap-client
build_daemon
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
plenalign=$root/target/debug/plenalign
# Nobody waits for an axis's way.
quick=()
for axis in focus e; do
  quick+=(--set "bench.$axis.speed_mm_per_s=20" --set "bench.$axis.acceleration_mm_per_s2=200")
done
# Progress is of no interest unless it fails.
for bits in 8 12; do
  PLENALIGN_STATE_DIR=$folder/state "$plenalign" align --json --seed 7 --record "$folder/$bits.mcap" \
    --set sensor.width_px=560 --set sensor.height_px=560 --set bench.simulation.rays=16 \
    --set bench.simulation.bits="$bits" "${quick[@]}" >"$folder/$bits.json" 2>"$folder/log" || {
    tail -n 20 "$folder/log" >&2
    exit 1
  }
  "$root/target/mcap-client/bin/python" client.py "$folder/$bits.mcap" "$folder/$bits.json" "$bits"
done
