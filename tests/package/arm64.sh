# shellcheck shell=bash disable=SC2016,SC2034,SC2154
# The arm64 package's program under QEMU, in the system that it was built in: with arm64's libraries, without any others of
# amd64 than QEMU's own.

runs_under_qemu() {
  local told pid
  debian_root arm64 "$(cat "$roots/arm64.packages")"
  in_layer "$DEBIAN_ROOT" arm64_program
}

arm64_program() {
  local pid end
  is "the package's architecture" "$(dpkg-deb -f "$deb" Architecture)" arm64
  dpkg-deb -x "$deb" "$root"
  has "the program is arm64's" "$(file -b "$root/usr/bin/plenalign" 2>/dev/null || readelf -h "$root/usr/bin/plenalign")" 'AArch64|aarch64'
  has "it says its version" "$(in_root "$root" qemu-aarch64-static /usr/bin/plenalign --version)" '^plenalign [0-9]'
  is "it designs the reference camera" \
    "$(in_root "$root" qemu-aarch64-static /usr/bin/plenalign design --json | jq '.joint.delta_v_mm * 1e9 | round')" 2205040031
  unshare --mount --net --pid --fork --kill-child bash -euo pipefail -c '
    ip link set lo up
    mount -t proc proc "$1/proc"
    exec chroot "$1" env -i PATH=/usr/bin:/bin PLENALIGN_STATE_DIR=/tmp/state qemu-aarch64-static /usr/bin/plenalign \
      serve --simulated --set bench.simulation.rays=4 --set sensor.width_px=400 --set sensor.height_px=400' arm64 "$root" \
    >"$work/arm64.log" 2>&1 &
  pid=$!
  cleanups+=("kill -KILL $pid 2>/dev/null")
  told=
  serves_or_ended() {
    told=$(nsenter --target "$(pgrep -P "$pid")" --net curl -sf --max-time 10 http://127.0.0.1:8080/healthz 2>/dev/null) ||
      ! kill -0 "$pid" 2>/dev/null
  }
  wait_for 120 serves_or_ended || true
  if [[ -z $told ]]; then
    cat "$work/arm64.log" >&2
    fail "arm64: the daemon does not serve"
  fi
  has "it serves" "$told" '"simulated":true'
  kill -TERM "$(pgrep -P "$pid")"
  wait "$pid" || fail "arm64: the daemon does not end in order"
  ok "and ends in order"
}
