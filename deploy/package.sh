#!/usr/bin/env bash
# Builds the Debian package into target/package/.
#
#   deploy/package.sh                 for this machine's architecture
#   ARCH=arm64 deploy/package.sh      for arm64, on an amd64 machine: see deploy/package-arm64.sh
#   PROFILE=dev deploy/package.sh     built with another profile of Cargo.toml than `dist`, as the packages' test does
set -euo pipefail
cd "$(dirname "$0")/.."

profile=${PROFILE:-dist}
own=$(dpkg --print-architecture 2>/dev/null) || {
  echo "package: a Debian package is built on a Debian machine, and there is no dpkg here" >&2
  exit 1
}
arch=${ARCH:-$own}
out=$PWD/target/package
# Reads the package's metadata in Cargo.toml.
cargo_deb_version=3.8.0
cargo_deb=$PWD/target/tools/cargo-deb-$cargo_deb_version

deploy/setup.sh package
make --no-print-directory web
if [[ ! -x $cargo_deb/bin/cargo-deb ]]; then
  echo "package: installing cargo-deb $cargo_deb_version into target/tools"
  # To be built soon matters more here than to run fast.
  CARGO_PROFILE_RELEASE_LTO=off CARGO_PROFILE_RELEASE_CODEGEN_UNITS=256 CARGO_PROFILE_RELEASE_OPT_LEVEL=1 \
    CARGO_TARGET_DIR=$PWD/target/tools/build cargo install --quiet --locked --root "$cargo_deb" cargo-deb \
    --version "=$cargo_deb_version"
  rm -rf target/tools/build
fi

case "$arch" in
  "$own")
    echo "package: building plenalign (profile $profile)"
    cargo build --quiet --locked --profile "$profile" --bin plenalign
    # Cargo's own name for what `dev` builds.
    run=("target/${profile/#dev/debug}/plenalign")
    pack() { "$cargo_deb/bin/cargo-deb" --no-build --locked --profile "$profile" "$@"; }
    ;;
  arm64)
    # Sets run and pack.
    . deploy/package-arm64.sh
    ;;
  *)
    echo "package: ARCH=$arch is neither this machine's $own nor arm64" >&2
    exit 1
    ;;
esac

rm -rf "$out/man" "$out/completions"
mkdir -p "$out/completions"
"${run[@]}" man "$out/man" >/dev/null
"${run[@]}" completions bash >"$out/completions/plenalign.bash"
"${run[@]}" completions zsh >"$out/completions/_plenalign"
"${run[@]}" completions fish >"$out/completions/plenalign.fish"
deploy/third-party.py | gzip -9n >"$out/third-party.gz"

rm -f "$out"/plenalign_*_"$arch".deb
pack --output "$out/" >/dev/null
deb=$(echo "$out"/plenalign_*_"$arch".deb)
[[ -f $deb ]] || { echo "package: no package came out in $out" >&2; exit 1; }
echo "package: ${deb#"$PWD/"} ($(($(stat -c %s "$deb") / 1024)) KiB)"
