#!/usr/bin/env bash
# The driver of GenICam cameras against Aravis's camera, which shares nothing with it. Camera and daemon are in two networks
# of their own with one cable between them: nothing gets out of either.
#
#   FRAMES=20   so many frames are looked at while packets are lost, by twenties
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

if [[ ${1:-} != inside ]]; then
  for tool in arv-fake-gv-camera-0.8 arv-tool-0.8 arv-camera-test-0.8; do
    command -v "$tool" >/dev/null || { echo "genicam: there is no $tool: deploy/setup.sh test installs it" >&2; exit 1; }
  done
  python_environment genicam
  build_daemon
  own_network ./run.sh inside
fi

plenalign=$root/target/debug/plenalign
folder=$(mktemp -d)
export PLENALIGN_STATE_DIR=$folder
there=
beyond=
aside=
camera_pid=
stranger_pid=
other_pid=
second_pid=
finish() {
  local status=$?
  if ((status != 0)) && [[ -e $folder/log ]]; then
    tail -n 30 "$folder/log" >&2
  fi
  for pid in $other_pid $daemon_pid $camera_pid $second_pid $stranger_pid $there $beyond $aside; do
    # Reaped here, so that the shell does not report it.
    { kill -KILL "$pid" && wait "$pid"; } 2>/dev/null || true
  done
  rm -rf "$folder"
}
trap finish EXIT

ip link set lo up
# connect CABLE NET: a network of its own at the other end of a cable; its process is then in `connected`.
connect() {
  unshare --net tail -f /dev/null &
  connected=$!
  its_own() { local net && net=$(readlink "/proc/$connected/ns/net") && [[ $net != $(readlink /proc/self/ns/net) ]]; }
  wait_for its_own
  ip link add "$1" type veth peer name "$1" netns "$connected"
  ip address add "$2.1/24" dev "$1"
  ip link set "$1" up
  nsenter --target "$connected" --net ip address add "$2.2/24" dev "$1"
  nsenter --target "$connected" --net ip link set "$1" up
  nsenter --target "$connected" --net ip link set lo up
}
connect cable 10.9.0
there=$connected
connect unnamed 10.8.0
beyond=$connected
connect aside 10.7.0
aside=$connected
elsewhere() { nsenter --target "$there" --net "$@"; }

# What runs in the other network is this shell's own child, and is ended by its number.
start_camera() {
  nsenter --target "$there" --net arv-fake-gv-camera-0.8 -i cable -s PLN-1 "$@" >/dev/null 2>&1 &
  camera_pid=$!
  wait_for answers
}
answers() { arv-tool-0.8 2>/dev/null | grep --quiet PLN-1; }
end_camera() {
  kill -KILL "$camera_pid"
  wait "$camera_pid" 2>/dev/null || true
}
# A camera that sends no frames, beside it; see there what else it can play.
start_stranger() {
  nsenter --target "$aside" --net python3 camera.py 10.7.0.2 PLN-3 "$@" >"$folder/reads" &
  stranger_pid=$!
  wait_for stranger_answers
}
stranger_answers() { arv-tool-0.8 2>/dev/null | grep --quiet PLN-3; }
end_stranger() {
  kill -KILL "$stranger_pid"
  wait "$stranger_pid" 2>/dev/null || true
}
client() { python3 client.py "$ADDRESS" "$@"; }
# A feature as Aravis reads it.
feature() { elsewhere arv-tool-0.8 -a 10.9.0.2 control "$1" | sed 's/^[^=]* = //; s/ .*//'; }

cat bench.toml - >"$folder/plenalign.toml" <<'TOML'
[sensor]
pixel_um = 3.45
width_px = 256
height_px = 200
[bench.controllers.main]
driver = "grbl"
port = "/dev/no-such-port"
[bench.camera]
driver = "genicam"
interfaces = ["cable", "aside", "no-such-cable"]
device = "serial:PLN-1"
format = "Mono8"
frame_rate_hz = 25.0
timeout_ms = 600
TOML

# Another camera, where nobody is to look.
nsenter --target "$beyond" --net arv-fake-gv-camera-0.8 -i unnamed -s PLN-2 >/dev/null 2>&1 &
second_pid=$!
start_camera
second_answers() { arv-tool-0.8 2>/dev/null | grep --quiet PLN-2; }
wait_for second_answers
listed=$("$plenalign" --config "$folder/plenalign.toml" camera list 2>/dev/null)
for line in '10.9.0.2  Aravis Fake (GigE Vision, cable)' '  device = "serial:PLN-1"' '  format = "Mono16"' '  not read: RGB8'; do
  grep --quiet --fixed-strings --line-regexp -- "$line" <<<"$listed"
done
if grep PLN-2 <<<"$listed"; then
  echo "a camera was looked for on an interface that is not configured" >&2
  exit 1
fi
"$plenalign" --config "$folder/plenalign.toml" doctor >"$folder/doctor" || true
grep --quiet 'camera  *Aravis Fake at 10.9.0.2 (GigE Vision), Mono8 256x200 at 25 Hz' "$folder/doctor"
echo "- listed by camera list and doctor, on the configured interface and on no other"

# compare SERIAL ADDRESS: features as GenICam's reference implementation reads them, too. Sets how many, and how many of them
# have limits and units.
compare() {
  "$plenalign" --config "$folder/plenalign.toml" camera controls "serial:$1" --json >"$folder/features"
  read -r features limits units < <("$root/target/genicam/bin/python" genapi.py "$2" "$folder/features")
}
compare PLN-1 10.9.0.2
((features >= 25 && limits >= 8))
start_stranger
compare PLN-3 10.7.0.2
((limits == 6 && units == 3))
told=$("$plenalign" --config "$folder/plenalign.toml" camera controls serial:PLN-3)
grep --quiet --line-regexp '  Gain  *= -1.25  *-1.5 to 24 dB' <<<"$told"
end_stranger
echo "- features read as GenICam's reference implementation reads them: values, limits, units"

# Another program has the camera for itself alone, and lets it go when its input ends.
mkfifo "$folder/until"
elsewhere python3 exclusive.py 10.9.0.2 <"$folder/until" >"$folder/exclusive" &
other_pid=$!
exec 9>"$folder/until"
wait_for says_or_ended "$folder/exclusive" "$other_pid"

"$plenalign" serve --config "$folder/plenalign.toml" --json --listen 127.0.0.1:0 --insecure \
  >"$folder/said" 2>"$folder/log" 9>&- &
daemon_pid=$!
wait_for says_or_ended "$folder/said" "$daemon_pid"
ADDRESS=$(sed -n 's/.*"address":"\([^"]*\)\/".*/\1/p' "$folder/said")
client fault "another program controls it: end that one"
exec 9>&-
wait "$other_pid"
client online
# Aravis's camera lets others read. Of one that does not:
start_stranger exclusive
"$plenalign" --config "$folder/plenalign.toml" camera list 2>/dev/null | grep --quiet 'cannot be used: another program controls it'
sed 's/serial:PLN-1/serial:PLN-3/' "$folder/plenalign.toml" >"$folder/other.toml"
"$plenalign" --config "$folder/other.toml" doctor >"$folder/doctor" || true
grep --quiet 'PROBLEM  *camera  *Nobody Stranger at 10.7.0.2 (GigE Vision): another program controls' "$folder/doctor"
end_stranger
echo "- had by another program for itself alone: told, by a camera that lets others read and by one that does not"

whole=$(client frames 20)
echo "- $whole frames, each whole"

start_stranger
client devices
client online
reads=$(grep --count read "$folder/reads")
[[ $reads == 1 ]] || { echo "the other camera was read $reads times" >&2; exit 1; }
echo "- listed by the API, the daemon's own and another, which was read once for 9 requests"
end_stranger

start_stranger endless
"$plenalign" --config "$folder/plenalign.toml" camera list 2>/dev/null | grep --quiet '1073741824 bytes long'
end_stranger
echo "- a description without an end is not read"

# What is set lands in the camera, and comes back to it after it was without power. On a busy machine its frames may be late,
# and the camera away for a moment, in which nothing is set.
exposes() { "$plenalign" camera exposure --server "$ADDRESS" --exposure "$1" >/dev/null; }
wait_for exposes 12.5
[[ $(feature ExposureTimeAbs) == 12500* ]]
end_camera
# By the frames that do not come, or by what it is asked each second.
client fault "it does not answer"
start_camera
client online
[[ $(feature ExposureTimeAbs) == 12500* ]]
echo "- killed and started again: taken again, exposed as before"

# The daemon stands still until its heartbeat has run out and arv-tool may write; then another program has the camera.
wait_for exposes 10
may_write() { elsewhere arv-tool-0.8 -a 10.9.0.2 control TestRegister=7 2>&1 | grep --quiet 'TestRegister = 7'; }
kill -STOP "$daemon_pid"
wait_for may_write
nsenter --target "$there" --net stdbuf --output=L arv-camera-test-0.8 -n Aravis-Fake-PLN-1 >"$folder/other" 2>&1 &
other_pid=$!
streams() { grep --quiet frame/s "$folder/other" 2>/dev/null; }
wait_for streams
kill -CONT "$daemon_pid"
client fault "another program controls it"
kill -INT "$other_pid"
wait "$other_pid" 2>/dev/null || true
client online
echo "- control taken by arv-tool and arv-camera-test: told, and taken again when the camera was free"

# One packet in a hundred is lost.
end_camera
client fault "it does not answer"
start_camera -r 10
client online
whole=0
while ((whole < ${FRAMES:-20})); do
  whole=$((whole + $(client frames 20)))
done
lost=$(client counted)
echo "- with packets lost: $whole frames shown, each whole; $lost were not, and counted"

end_daemon
# Nobody has control of it, and no heartbeat has to run out first.
elsewhere python3 -c 'import gvcp, sys; sys.exit(gvcp.Client("10.9.0.2").register(gvcp.CONTROL_PRIVILEGE))'
echo "- let go when the daemon ends"
