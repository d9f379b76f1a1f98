#!/usr/bin/env bash
# The drivers against a real kernel, in a guest under QEMU: the camera's against vivid and v4l2loopback with the faults
# that they inject; then a whole alignment by a daemon in the guest, whose world is rendered here. No hardware is needed,
# nor a kernel that loads modules.
#
#   tests/hardware/run.sh          every test
#   tests/hardware/run.sh NAME...  the camera's whose names contain one of these; `cameras`: all of them; `chain`: the
#                                  alignment
set -euo pipefail
cd "$(dirname "$0")/../.."
skip() {
  echo "hardware tests skipped because $1"
  exit 0
}
started=$SECONDS
wanted=$*
[[ $(uname -m) == x86_64 ]] || skip "the guest's kernel is for x86_64 and this machine is $(uname -m)"
command -v apt-get >/dev/null || skip "the guest is made of Debian packages and there is no apt-get here"
mkdir -p target/hardware/share
log=target/hardware/setup.log
deploy/setup.sh hardware >"$log" 2>&1 || skip "what it needs cannot be installed: $(tail -n 1 "$log")"
qemu-system-x86_64 -machine none -accel help 2>/dev/null | grep -q tcg || skip "this QEMU cannot emulate (no tcg)"

. tests/lints.sh
binary=$(cargo test --quiet --no-run --test hardware --message-format=json |
  sed -n 's/.*"target":{[^}]*"name":"hardware".*"executable":"\([^"]*\)".*/\1/p' | tail -n 1)
[[ -x $binary ]] || { echo "hardware: the test binary was not built" >&2; exit 1; }
cp "$binary" target/hardware/plenalign-hardware
tests/hardware/image.sh "$PWD/target/hardware/plenalign-hardware" arv-tool-0.8 arv-camera-test-0.8 >target/hardware/image.log 2>&1 || {
  grep -qE 'Unable to (fetch|locate)|Could not resolve|Failed to fetch' target/hardware/image.log &&
    skip "its Debian packages cannot be fetched: $(tail -n 1 target/hardware/image.log)"
  tail -n 20 target/hardware/image.log >&2
  exit 1
}

share=target/hardware/share
cp tests/hardware/{cameras,chain}.sh "$share/"
strip -o "$share/plenalign" target/debug/plenalign
failed() {
  echo "hardware tests FAILED after $((SECONDS - started)) s; the end of $1:" >&2
  tail -n 40 "$1" >&2
  local crash='BUG:|Oops|general protection fault|Kernel panic'
  if grep -qE "$crash" "$1"; then
    echo "hardware: the guest's kernel crashed:" >&2
    grep -m 1 -E -B 5 -A 25 "$crash" "$1" >&2
  fi
  exit 1
}

if [[ $* != chain ]]; then
  [[ $* != cameras ]] || set --
  printf '%s\n' "$@" >"$share/filters"
  rm -f "$share/exit-code"
  console=target/hardware/console.log
  # One processor: with two, emulated in parallel, the guest's kernel once found its memory corrupted. It is no faster.
  CPUS=1 tests/hardware/qemu.sh cameras.sh 2>&1 | tr -d '\r' | tee "$console" | grep --line-buffered '^hardware: ' || true
  [[ $(cat "$share/exit-code" 2>/dev/null) == 0 ]] || failed "$console"
fi
if [[ $wanted == "" || $wanted == chain ]]; then
  target/hardware/plenalign-hardware chain "$share" || failed target/hardware/chain.log
fi
echo "hardware tests passed in $((SECONDS - started)) s"
