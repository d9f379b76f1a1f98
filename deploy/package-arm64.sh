# shellcheck shell=bash disable=SC2016,SC2034,SC2154
# Builds the program for arm64 on an amd64 machine, sourced by package.sh: in a Debian system of its own, since packages of
# a foreign architecture would mix with this machine's. There Debian's rustc-web (a Rust of today for its browsers) has the
# standard library for arm64. Sets
#
#   run    what runs the program that was built, under QEMU
#   pack   what makes the package of it

. deploy/root.sh

arm64_packages=(
  # The compiler and arm64's standard library.
  rustc-web cargo-web libstd-rust-web-dev:arm64
  # The linker, cc for crates that build C, and the libraries that they and the program are linked with.
  crossbuild-essential-arm64 libc6-dev:arm64 libgcc-s1:arm64
  # bindgen, which reads the kernel's V4L2 headers.
  libclang-dev linux-libc-dev:arm64
  # Runs what was built.
  qemu-user-static
)
[[ $own == amd64 ]] || {
  echo "package: for arm64 on $own there is no recipe; on an arm64 machine no ARCH is needed" >&2
  exit 1
}
[[ $(id -u) == 0 ]] || {
  echo "package: a Debian system to build for arm64 in is made and entered as root" >&2
  exit 1
}
FOREIGN=arm64 debian_root arm64 "${arm64_packages[@]}"
triple=aarch64-unknown-linux-gnu
export CARGO_HOME=${CARGO_HOME:-$HOME/.cargo}

# Runs a command there, in this folder.
in_arm64() {
  unshare --mount --propagation private bash -euo pipefail -c '
    . deploy/root.sh
    root=$1 project=$2 cargo=$3; shift 3
    mkdir -p "$root$project" "$root/cargo"
    mount --bind "$project" "$root$project"
    mount --bind "$cargo" "$root/cargo"
    in_root "$root" env -C "$project" CARGO_HOME=/cargo CARGO_TARGET_DIR="$project/target/arm64" "$@"' \
    in_arm64 "$DEBIAN_ROOT" "$PWD" "$CARGO_HOME" "$@"
}

cargo fetch --quiet --locked
echo "package: building plenalign for arm64 (profile $profile)"
in_arm64 env \
  CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc \
  CC_aarch64_unknown_linux_gnu=aarch64-linux-gnu-gcc \
  AR_aarch64_unknown_linux_gnu=aarch64-linux-gnu-ar \
  BINDGEN_EXTRA_CLANG_ARGS_aarch64_unknown_linux_gnu="--target=aarch64-linux-gnu -I/usr/include/aarch64-linux-gnu" \
  cargo build --quiet --locked --offline --profile "$profile" --target "$triple" --bin plenalign
# cargo-deb would take this machine's strip, which knows no arm64.
in_arm64 aarch64-linux-gnu-strip --strip-all "target/arm64/$triple/$profile/plenalign"
run=(in_arm64 qemu-aarch64-static "target/arm64/$triple/$profile/plenalign")
pack() {
  in_arm64 "$cargo_deb/bin/cargo-deb" --no-build --no-strip --locked --offline --target "$triple" --profile "$profile" "$@"
}
