#!/usr/bin/env bash
# Live measuring of a camera of 4096 x 3072 pixels in Mono8 over GigE Vision: readings a second, how old they are when they come,
# frames lost, and what of the processor daemon and camera take, for large packets and for ordinary ones. Camera and daemon are
# in two networks of their own with one cable between them, and run on this one machine: the camera sends five pictures again
# and again, as fast as it is asked to.
#
#   benches/network/run.sh [MTU...]      9000 and 1500
#
#   SENSOR=4096x3072   columns and rows
#   RATE_HZ=30         frames a second that are asked for
#   LINK_MBIT_S=10000  what the camera's link carries
#   SECONDS_EACH=20    for how long it is measured
#   PROGRAM=FILE       the program; otherwise it is built as it is released
set -euo pipefail
cd "$(dirname "$0")"
. ../../tests/daemon.sh
root=$(realpath "$root")

if [[ ${1:-} != inside ]]; then
  [[ -x $root/target/python-client/bin/python ]] || {
    echo "network: the Python client is not there: tests/python-client/run.sh sets it up" >&2
    exit 1
  }
  [[ -n ${PROGRAM:-} ]] || cargo build --release --quiet --manifest-path "$root/Cargo.toml"
  own_network ./run.sh inside "$@"
fi
shift
plenalign=$(realpath "${PROGRAM:-$root/target/release/plenalign}")
sensor=${SENSOR:-4096x3072}
folder=$(mktemp -d)
there=
stage_pid=
finish() {
  local status=$?
  if ((status != 0)); then
    tail -n 20 "$folder"/*.log >&2 || true
  fi
  for pid in $daemon_pid $stage_pid $there; do
    # Reaped here, so that the shell does not report it.
    { kill -KILL "$pid" && wait "$pid"; } 2>/dev/null || true
  done
  rm -rf "$folder"
}
trap finish EXIT

ip link set lo up
unshare --net tail -f /dev/null &
there=$!
its_own() { local net && net=$(readlink "/proc/$there/ns/net") && [[ $net != $(readlink /proc/self/ns/net) ]]; }
wait_for its_own
ip link add cable type veth peer name cable netns "$there"
elsewhere() { nsenter --target "$there" --net "$@"; }
ip address add 10.9.0.1/24 dev cable
ip link set cable up
elsewhere ip address add 10.9.0.2/24 dev cable
elsewhere ip link set cable up
elsewhere ip link set lo up

cat ../../tests/genicam/bench.toml - >"$folder/plenalign.toml" <<TOML
[sensor]
pixel_um = 3.45
width_px = ${sensor%x*}
height_px = ${sensor#*x}
[bench.controllers.main]
driver = "grbl"
port = "$folder/stage"
[bench.camera]
driver = "genicam"
device = "10.9.0.2"
format = "Mono8"
frame_rate_hz = ${RATE_HZ:-30}
timeout_ms = 120000
timestamp_means = "exposure_end"
TOML
as_twin=(--config "$folder/plenalign.toml" --set bench.simulation.rays=4)

"$plenalign" "${as_twin[@]}" sim-stage --json --protocol grbl --link "$folder/stage" --record "$folder/slides" \
  >"$folder/stage.said" 2>"$folder/stage.log" &
stage_pid=$!
wait_for says_or_ended "$folder/stage.said" "$stage_pid"
(($# > 0)) || set -- 9000 1500
echo "sockets' buffers: $(sysctl -n net.core.rmem_max) bytes at most; load: $(cut -d' ' -f1-3 /proc/loadavg)"
for mtu in "$@"; do
  ip link set cable mtu "$mtu"
  elsewhere ip link set cable mtu "$mtu"
  rm -f "$folder/said"
  # What it is told: in a network that was made here the system does not say what the interface carries.
  PLENALIGN_STATE_DIR=$folder/state-$mtu "$plenalign" serve --config "$folder/plenalign.toml" --set bench.camera.packet_bytes="$mtu" \
    --json --listen 127.0.0.1:0 --insecure \
    >"$folder/said" 2>"$folder/daemon.log" &
  daemon_pid=$!
  wait_for says_or_ended "$folder/said" "$daemon_pid"
  ADDRESS=$(sed -n 's/.*"address":"\([^"]*\)\/".*/\1/p' "$folder/said")
  PATIENCE_S=1800 PYTHONPATH=$root/tests/genicam "$root/target/python-client/bin/python" live.py "$ADDRESS" "$daemon_pid" "$mtu" \
    "${SECONDS_EACH:-20}" nsenter --target "$there" --net "$plenalign" "${as_twin[@]}" sim-camera --json --listen 10.9.0.2 \
    --slides "$folder/slides" --link-mbit-s "${LINK_MBIT_S:-10000}" --timestamp-means exposure_end
  kill -TERM "$daemon_pid"
  wait "$daemon_pid" || true
  daemon_pid=
done
