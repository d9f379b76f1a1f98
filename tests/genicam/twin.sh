#!/usr/bin/env bash
# The simulated camera, `plenalign sim-camera`, judged by Aravis, which shares nothing with it; then the driver of GenICam
# cameras judged by it: an alignment with nothing simulated in the daemon, its stage a twin behind a pseudo-terminal.
# Everything is in a network of its own.
#
#   twin.sh               what `make test` runs: a small camera
#   SENSOR=4096x3072 PROGRAM=$PWD/target/release/plenalign twin.sh
#                         the alignment alone, with a camera of that size: it takes as long as its frames do in rendering
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

if [[ ${1:-} != inside ]]; then
  for tool in arv-tool-0.8 arv-camera-test-0.8; do
    command -v "$tool" >/dev/null || { echo "twin: there is no $tool: deploy/setup.sh test installs it" >&2; exit 1; }
  done
  build_daemon
  own_network ./twin.sh inside
fi

plenalign=$(realpath "${PROGRAM:-$root/target/debug/plenalign}")
# Columns, rows and the pixel's size; the camera's rate, and what its slowest frame may take.
columns=374 rows=374 pixel_um=5.175 rate_hz=10.0 timeout_ms=3000
if [[ -n ${SENSOR:-} ]]; then
  columns=${SENSOR%x*} rows=${SENSOR#*x} pixel_um=3.45 rate_hz=1.0 timeout_ms=120000
  export PATIENCE_S=${PATIENCE_S:-7200}
fi
folder=$(mktemp -d)
export PLENALIGN_STATE_DIR=$folder/state
camera_pid=
second_pid=
client_pid=
stage_pid=
finish() {
  local status=$?
  if ((status != 0)) && [[ -e $folder/log ]]; then
    tail -n 30 "$folder/log" >&2
  fi
  for pid in $client_pid $daemon_pid $stage_pid $second_pid $camera_pid; do
    # Reaped here, so that the shell does not report it.
    { kill -KILL "$pid" && wait "$pid"; } 2>/dev/null || true
  done
  rm -rf "$folder"
}
trap finish EXIT
# Packets that are larger do not come through, which test packets are to show.
ip link set lo up mtu 4000

cat bench.toml - >"$folder/plenalign.toml" <<TOML
[sensor]
pixel_um = $pixel_um
width_px = $columns
height_px = $rows
[bench.controllers.main]
driver = "grbl"
port = "$folder/stage"
[bench.camera]
driver = "genicam"
device = "127.0.0.1"
format = "Mono12p"
frame_rate_hz = $rate_hz
timeout_ms = $timeout_ms
timestamp_means = "exposure_end"
TOML
# What renders has fewer rays to a pixel, to keep pace.
as_twin=(--config "$folder/plenalign.toml" --set bench.simulation.rays=16)

# start_camera OPTION...
start_camera() {
  "$plenalign" "${as_twin[@]}" sim-camera --json --serial TWIN-1 "$@" >"$folder/camera" 2>"$folder/camera.log" </dev/null &
  camera_pid=$!
  wait_for says_or_ended "$folder/camera" "$camera_pid"
  wait_for answers
}
answers() { [[ $(arv-tool-0.8 2>/dev/null) == "Plenalign-SimulatedCamera-TWIN-1 (127.0.0.1)" ]]; }
end_camera() {
  kill -TERM "$camera_pid"
  wait "$camera_pid"
  camera_pid=
}
control() { arv-tool-0.8 -a 127.0.0.1 control "$@"; }

judged_by_aravis() {
  local link='{"lost_one_in": 100, "late_one_in": 200, "doubled_one_in": 100}'
  echo "{\"events\": [{\"at_s\": 0, \"faults\": {\"link\": $link}}]}" >"$folder/plan.json"
  start_camera --faults "$folder/plan.json"
  arv-tool-0.8 -a 127.0.0.1 genicam >"$folder/xml"
  python3 -c 'import sys, xml.dom.minidom; xml.dom.minidom.parse(sys.argv[1])' "$folder/xml"
  # Every feature has a value, but for what is commanded.
  arv-tool-0.8 -a 127.0.0.1 values >"$folder/values" 2>&1
  for line in "'DeviceVendorName' = 'Plenalign'" "'DeviceSerialNumber' = 'TWIN-1'" "'PixelFormat' = 'Mono8'" "'Width' = 374 px" \
    "'ExposureTime' = 10000 us" "'Gain' = 0 dB" "'PayloadSize' = 139876 B" "'GevTimestampTickFrequency' = 1000000000 Hz"; do
    grep --quiet --fixed-strings -- "$line" "$folder/values" || { cat "$folder/values" >&2; exit 1; }
  done
  if grep --ignore-case --quiet error "$folder/values"; then
    grep --ignore-case error "$folder/values" >&2
    exit 1
  fi
  set_up=$(control Width=320 OffsetX=20 PixelFormat=Mono12p ExposureTime=5000.5 Gain=6 DeviceUserID=bench PayloadSize)
  for line in 'Width = 320' 'OffsetX = 20' 'PixelFormat = Mono12p' 'ExposureTime = 5000.5' 'Gain = 6' 'DeviceUserID = bench' \
    'PayloadSize = 179520'; do
    grep --quiet --fixed-strings -- "$line" <<<"$set_up" || { echo "$set_up" >&2; exit 1; }
  done
  refused=$(control Width=375 ExposureTime=99 2>&1)
  (($(grep --count invalid-parameter <<<"$refused") == 2)) || { echo "$refused" >&2; exit 1; }
  control OffsetX=0 PixelFormat=Mono8 Width=374 ExposureTime=10000 Gain=0 >/dev/null
  echo "- found, read and set by arv-tool"

  listed=$("$plenalign" --config "$folder/plenalign.toml" --set 'bench.camera.interfaces=["lo"]' camera list)
  for line in '127.0.0.1  Plenalign SimulatedCamera (GigE Vision, lo)' '  device = "serial:TWIN-1"' '  format = "Mono10p"' \
    '  format = "Mono16"'; do
    grep --quiet --fixed-strings --line-regexp -- "$line" <<<"$listed" || { echo "$listed" >&2; exit 1; }
  done
  # Another, whose sensor has filters.
  "$plenalign" "${as_twin[@]}" --set sensor.mosaic=rggb --set bench.camera.format=BayerRG8 sim-camera --json --serial TWIN-2 \
    --listen 127.0.0.2 >"$folder/second" 2>"$folder/second.log" </dev/null &
  second_pid=$!
  both_answer() { (($(arv-tool-0.8 2>/dev/null | grep --count TWIN-) == 2)); }
  wait_for both_answer
  coloured=$(arv-tool-0.8 -a 127.0.0.2 control PixelFormat=BayerRG12p PayloadSize)
  grep --quiet 'PayloadSize = 209814' <<<"$coloured" || { echo "$coloured" >&2; exit 1; }
  kill -TERM "$second_pid"
  wait "$second_pid"
  second_pid=
  echo "- listed by camera list, and another with a mosaic found beside it"

  # The clock goes on between two readings, in its own ticks.
  clock() { control GevTimestampControlLatch GevTimestampValue | sed -n 's/^GevTimestampValue = \([0-9]*\).*/\1/p'; }
  first=$(clock)
  second=$(clock)
  ((second > first && second - first < 5000000000))
  echo "- its clock read: $((second - first)) ticks from one reading to the next"

  # One packet in a hundred is lost and asked for again; others come late, or twice.
  arv-camera-test-0.8 -n Plenalign-TWIN-1 -f 20 -j always -m 2000 --duration 4 >"$folder/streamed" 2>&1
  figure() { sed -n "s/.*$1 *= *\([0-9]*\).*/\1/p" "$folder/streamed"; }
  (($(figure 'gv packet size') == 4000)) || { cat "$folder/streamed" >&2; exit 1; }
  (($(figure n_completed_buffers) > 10 && $(figure n_failures) == 0 && $(figure n_resent_packets) > 0)) ||
    { cat "$folder/streamed" >&2; exit 1; }
  echo "- $(figure n_completed_buffers) frames taken by arv-camera-test, each whole; $(figure n_resent_packets) packets sent again"

  # A second client is refused, until the first has been silent for longer than its heartbeat.
  stdbuf --output=L arv-camera-test-0.8 -n Plenalign-TWIN-1 -f 20 >"$folder/first" 2>&1 &
  client_pid=$!
  streams() { grep --quiet 'frames*/s' "$folder/first" 2>/dev/null; }
  wait_for streams
  set_width() { control Width=320 2>&1; }
  if set_width | grep --quiet 'Width = 320'; then
    echo "a second client set what the first has control of" >&2
    exit 1
  fi
  kill -STOP "$client_pid"
  may_write() { set_width | grep --quiet 'Width = 320'; }
  wait_for may_write
  kill -KILL "$client_pid"
  wait "$client_pid" 2>/dev/null || true
  client_pid=
  echo "- a second client refused, and let in once the first was silent"
  end_camera
}

aligned() {
  # Stage and camera are twins, the daemon knows of no simulation: five packets in a thousand are lost, and the camera is
  # without power once.
  "$plenalign" --config "$folder/plenalign.toml" sim-stage --json --protocol grbl --link "$folder/stage" \
    --record "$folder/slides" >"$folder/stage.said" &
  stage_pid=$!
  wait_for says_or_ended "$folder/stage.said" "$stage_pid"
  "$plenalign" serve --config "$folder/plenalign.toml" --json --listen 127.0.0.1:0 --insecure \
    >"$folder/said" 2>"$folder/log" &
  daemon_pid=$!
  wait_for says_or_ended "$folder/said" "$daemon_pid"
  ADDRESS=$(sed -n 's/.*"address":"\([^"]*\)\/".*/\1/p' "$folder/said")
  python3 align.py "$ADDRESS" "$plenalign" "${as_twin[@]}" sim-camera --json --serial TWIN-1 --slides "$folder/slides" \
    --lost-one-in 200 --timestamp-means exposure_end
}

if [[ -z ${SENSOR:-} ]]; then
  judged_by_aravis
fi
aligned
