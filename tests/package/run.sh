#!/usr/bin/env bash
# The Debian package: built, checked as Debian checks its own, installed, upgraded, removed and purged in Debian systems of
# its own, one of them booted with systemd; the container file's steps. Nothing of this machine is changed, and no network
# but loopback is reached except for Debian's packages.
#
#   tests/package/run.sh           packs the program that all tests run (PROFILE=dev) and tests that package
#   PROFILE=dist tests/package/run.sh   the package as it is handed out
#   ARCH=arm64 tests/package/run.sh     builds one for arm64 (PROFILE=release) and runs its program under QEMU
set -euo pipefail
cd "$(dirname "$0")/../.."

fail() {
  echo "package: $*" >&2
  exit 1
}

if [[ ${1:-} != inside ]]; then
  started=$SECONDS
  if [[ -z ${PROFILE:-}${ARCH:-} ]]; then
    # To optimise the program takes longer than to test its package, and changes nothing of what is installed and how it
    # behaves.
    PROFILE=dev
    . tests/lints.sh
  fi
  export PROFILE=${PROFILE:-release}
  deploy/package.sh
  echo "package: built in $((SECONDS - started)) s"
  arch=${ARCH:-$(dpkg --print-architecture)}
  deb=$(echo target/package/plenalign_*_"$arch".deb)
  as_root=()
  if [[ $(id -u) != 0 ]]; then
    command -v sudo >/dev/null || fail "a Debian system is made and entered as root, and neither root nor sudo is at hand"
    as_root=(sudo)
  fi
  # Every mount is this namespace's, and is gone with it.
  exec "${as_root[@]}" unshare --mount --propagation private "tests/package/run.sh" inside "$deb" "$arch"
fi

deb=$(realpath "$2") arch=$3
# shellcheck source=deploy/root.sh
. deploy/root.sh
. tests/package/lib.sh

part "lintian" lintian_finds_nothing
if [[ $arch != "$(dpkg --print-architecture)" ]]; then
  . tests/package/arm64.sh
  part "$arch program under QEMU" runs_under_qemu
  all_passed
fi

part "Debian systems" roots_made
. tests/package/devices.sh
. tests/package/static.sh
part "installed without systemd" in_fresh_root installed_without_systemd
. tests/package/booted.sh
part "installed under systemd" in_fresh_root installed_under_systemd
. tests/package/container.sh
part "container file" container_file
all_passed
