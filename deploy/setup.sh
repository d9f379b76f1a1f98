#!/usr/bin/env bash
# Installs from Debian what Plenalign needs beside the Rust toolchain and Node: as root, or through sudo.
#
#   deploy/setup.sh build   what `make run` needs
#   deploy/setup.sh test    that, and what `make test` needs besides
#   deploy/setup.sh bench   what `make run` needs, and what `make bench` needs besides
#   deploy/setup.sh hardware  what `make run` needs, and what `make test-hardware` needs besides
#   deploy/setup.sh package   what `make run` needs, and what `make package` and `make test-package` need besides
#
# Says what it is going to install before it does, and does nothing where everything is there.
set -euo pipefail

# build-essential   the linker, and cc for crates that build C
# libclang-dev      bindgen, which reads the kernel's V4L2 headers for the v4l crate
# linux-libc-dev    those headers
# curl              the tests' plain HTTP client
# libturbojpeg0     encodes pictures for viewers in half the time; used where it is there, and not needed to build
build_packages=(build-essential libclang-dev linux-libc-dev git ca-certificates curl libturbojpeg0)
# chromium          the browser in which the page is tested
# openssl           another's opinion of the certificates made, and the MQTT broker's
# python3           the table of `make test-long`
# jq                reads answers in the documentation's commands
# sqlite3           backs a history up, as the documentation says
# python3-venv      where the stage vendors' clients, Schemathesis and other tools' clients are put
# iproute2, util-linux   a network of its own for the tests of announcement, Alpaca, MQTT and cameras on the network
# slurmctld, slurmd, slurm-client, munge   the study's parts and their merge in a cluster of two nodes on this machine
# aravis-tools, aravis-tools-cli   a GigE Vision camera that is not ours, and others who want it
test_packages=(chromium openssl jq sqlite3 python3 python3-venv iproute2 util-linux
  slurmctld slurmd slurm-client munge aravis-tools aravis-tools-cli)
# python3-venv      where the comparison's OpenCV and NumPy are put
bench_packages=(python3 python3-venv)
# qemu-system-x86   emulates the machine that the virtual cameras run on
# busybox-static, cpio, zstd, kmod   its root in memory
# gcc-12, make, python3   build v4l2loopback and unpack the kernel
# v4l-utils         the tests' own hand on a camera's controls
# aravis-tools, aravis-tools-cli   others' word on the USB3 Vision camera that the driver is tried with
hardware_packages=(qemu-system-x86 busybox-static cpio zstd kmod gcc-12 make python3 v4l-utils
  aravis-tools aravis-tools-cli)
# dpkg-dev          finds out which libraries' packages the program depends on
# python3           gathers the notices of what the program contains; reads the container file in its test
# lintian           checks the package as Debian checks its own
# debootstrap, util-linux   a Debian system of its own, to build and to install in
# iproute2, procps  a network of its own, and what runs in it
# jq                reads answers of the daemon installed there
package_packages=(dpkg-dev python3 lintian debootstrap util-linux iproute2 procps jq)

what=${1:-test}
case "$what" in
  build) packages=("${build_packages[@]}") ;;
  test) packages=("${build_packages[@]}" "${test_packages[@]}") ;;
  bench) packages=("${build_packages[@]}" "${bench_packages[@]}") ;;
  hardware) packages=("${build_packages[@]}" "${hardware_packages[@]}") ;;
  package) packages=("${build_packages[@]}" "${package_packages[@]}") ;;
  *) echo "setup: '$what' is none of 'build', 'test', 'bench', 'hardware' and 'package'" >&2; exit 2 ;;
esac

for tool in cargo node npm; do
  if ! command -v "$tool" >/dev/null; then
    echo "setup: $tool is not on the PATH; install the Rust toolchain (1.95 or newer, rustup) and Node (20.19 or newer) first" >&2
    exit 1
  fi
done
node -e 'const [a, b] = process.versions.node.split(".").map(Number); process.exit(a > 20 || (a === 20 && b >= 19) ? 0 : 1)' || {
  echo "setup: Node $(node --version) is too old; 20.19 or newer is needed" >&2
  exit 1
}

missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query -W -f='${db:Status-Abbrev}' "$package" 2>/dev/null || true)
  [[ $status == ii* ]] || missing+=("$package")
done
if ((${#missing[@]} == 0)); then
  exit 0
fi

as_root=()
if [[ $(id -u) != 0 ]]; then
  command -v sudo >/dev/null || {
    echo "setup: these Debian packages are missing and neither root nor sudo is at hand: ${missing[*]}" >&2
    exit 1
  }
  as_root=(sudo)
fi
echo "setup: installing from Debian: ${missing[*]}"
log=$(mktemp)
if ! { "${as_root[@]}" apt-get update && "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
  apt-get install -y --no-install-recommends "${missing[@]}"; } >"$log" 2>&1; then
  echo "setup: apt-get failed:" >&2
  tail -n 20 "$log" >&2
  exit 1
fi
rm -f "$log"
