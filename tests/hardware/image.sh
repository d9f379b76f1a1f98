#!/usr/bin/env bash
# Makes target/hardware/{vmlinux,initrd.img}: a Debian kernel with the virtual cameras and serial ports that the tests
# drive, and a small root in memory. From Debian packages alone; nothing of the kernel's is installed here.
#
#   tests/hardware/image.sh BINARY...   the binaries are put into the guest's /usr/bin with their libraries
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$(cd "$here/../.." && pwd)/target/hardware
mkdir -p "$work/debs"
cd "$work"

depends_on() { apt-cache depends "$1" | sed -n "s/^ *Depends: *\($2[^ ]*\).*/\1/p" | head -n 1; }
# Lists of packages that are missing or old are fetched anew, where that may be done.
new_lists() { [[ $(id -u) == 0 ]] && apt-get update -qq; }
package=$(depends_on linux-image-amd64 linux-image-)
if [[ -z $package ]]; then
  new_lists || true
  package=$(depends_on linux-image-amd64 linux-image-)
fi
[[ -n $package ]] || { echo "image: Unable to locate linux-image-amd64; run apt-get update" >&2; exit 1; }
version=${package#linux-image-}
download() {
  (cd debs && apt-get download -qq "$package" v4l2loopback-dkms "linux-headers-$version" \
    "linux-headers-${version%-amd64}-common" "$(depends_on "linux-headers-$version" linux-kbuild-)")
}
if [[ ! -e debs/$package.done ]]; then
  rm -rf kernel v4l2loopback debs/*.deb
  download || { new_lists && download; }
  touch "debs/$package.done"
fi
if [[ ! -d kernel/lib/modules/$version ]]; then
  rm -rf kernel && dpkg-deb -x debs/"${package}"_*.deb kernel
fi

# v4l2loopback is source: built against the headers, which are unpacked and not installed.
if [[ ! -e v4l2loopback/v4l2loopback.ko ]]; then
  rm -rf headers v4l2loopback dkms
  for deb in debs/linux-headers-* debs/linux-kbuild-*; do dpkg-deb -x "$deb" headers; done
  dpkg-deb -x debs/v4l2loopback-dkms_*.deb dkms
  cp -r dkms/usr/src/v4l2loopback-* v4l2loopback
  tree=$work/headers/usr/src/linux-headers-$version
  # The headers name each other by the places they would be installed in.
  grep -rlE '/usr/(src|lib)/linux-' "$tree/Makefile" "$tree/scripts" 2>/dev/null | xargs -r sed -i "s#/usr/src/linux-#$work/headers/usr/src/linux-#g; s#/usr/lib/linux-#$work/headers/usr/lib/linux-#g" || true
  rm -f "$tree/scripts" "$tree/tools"
  kbuild=$(echo "$work"/headers/usr/lib/linux-kbuild-*)
  ln -sfn "$kbuild/scripts" "$tree/scripts"
  ln -sfn "$kbuild/tools" "$tree/tools"
  make -s -C "$tree" M="$work/v4l2loopback" CC=gcc-12 modules >v4l2loopback.log 2>&1 || {
    echo "image: v4l2loopback does not build:" >&2
    tail -n 20 v4l2loopback.log >&2
    exit 1
  }
fi

# Unpacked, the kernel starts at once: emulation would take seconds to unpack it.
if [[ ! -e vmlinux || vmlinux -ot kernel/boot/vmlinuz-$version ]]; then
  python3 - "kernel/boot/vmlinuz-$version" vmlinux <<'PYTHON'
import lzma, sys
data = open(sys.argv[1], "rb").read()
at = data.find(b"\xfd7zXZ\x00")
while at >= 0:
    try:
        kernel = lzma.LZMADecompressor(lzma.FORMAT_XZ).decompress(data[at:])
        if kernel[:4] == b"\x7fELF":
            open(sys.argv[2], "wb").write(kernel)
            break
    except lzma.LZMAError:
        pass
    at = data.find(b"\xfd7zXZ\x00", at + 6)
else:
    sys.exit("image: there is no kernel in " + sys.argv[1])
PYTHON
fi

modules="virtio_pci virtio_net virtio_rng 9p 9pnet_virtio vivid v4l2loopback usbcore xhci_pci xhci_hcd usbserial ftdi_sio cdc_acm vhci_hcd"
root=$work/root
rm -rf "$root"
mkdir -p "$root"/{bin,sbin,proc,sys,dev,tmp,run,etc,mnt/host,usr/bin} "$root/lib/modules/$version"
tree=kernel/lib/modules/$version
mkdir -p "$tree/extra"
cp v4l2loopback/v4l2loopback.ko "$tree/extra/"
depmod -b kernel "$version" 2>/dev/null
for module in $modules; do
  modprobe -d kernel -S "$version" --show-depends "$module" 2>/dev/null | awk '/^insmod/ {print $2}'
done | sort -u | while read -r file; do
  to=$root/lib/modules/$version/${file#*lib/modules/"$version"/}
  mkdir -p "$(dirname "$to")" && cp "$file" "$to"
done
cp "$tree"/modules.{builtin,order} "$root/lib/modules/$version/"
depmod -b "$root" "$version" 2>/dev/null
cp /bin/busybox "$root/bin/busybox"
for applet in $(/bin/busybox --list); do
  [[ -e $root/bin/$applet ]] || ln -s busybox "$root/bin/$applet"
done
ln -sf /bin/busybox "$root/sbin/modprobe"

with_libraries() {
  local binary
  binary=$(command -v "$1")
  cp -L "$binary" "$root/usr/bin/"
  ldd "$binary" 2>/dev/null | grep -oE '/[^ ]+' | while read -r library; do
    mkdir -p "$root$(dirname "$library")" && cp -nL "$library" "$root$library"
  done
}
for binary in v4l2-ctl "$@"; do with_libraries "$binary"; done
cp "$here/init" "$root/init" && chmod 755 "$root/init"
(cd "$root" && find . | cpio -o -H newc --quiet | zstd -q -3 -T0 -f -o "$work/initrd.img")
