# shellcheck shell=bash disable=SC2016,SC2034,SC2154
# A Debian system in a folder, made by debootstrap, sourced by what builds or tests packages in one. It is of the release
# that this machine has: what is built here links with its libraries.
#
#   debian_root NAME PACKAGE...   makes target/roots/NAME, or keeps it where it has these packages; sets DEBIAN_ROOT. With
#                                 FOREIGN=ARCHITECTURE packages may be of that, too
#   in_root ROOT COMMAND...       runs a command in one, in a PID namespace of its own that ends with it
#
# As root; `in_root` in a mount namespace that the caller made, with ROOT's /proc, /dev and /sys mounted in that alone.

roots=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)/target/roots

# The machine's own sources of Debian packages, for another root's sources.list.
debian_sources() {
  local sources
  sources=$(apt-get indextargets --format 'deb $(REPO_URI) $(RELEASE) $(COMPONENT)' 'Origin: Debian' 'Created-By: Packages' |
    grep -v -- '-backports' | sort -u)
  if [[ -z $sources ]]; then
    echo "root: apt-get knows no Debian packages here: 'apt-get update' first; and the machine has to be a Debian one" >&2
    return 1
  fi
  echo "$sources"
}

debian_root() {
  local name=$1 suite mirror sources log
  shift
  DEBIAN_ROOT=$roots/$name
  if [[ -f $roots/$name.packages && $(<"$roots/$name.packages") == "$*" ]]; then
    return
  fi
  echo "root: making a Debian system in target/roots/$name"
  suite=$(. /etc/os-release && echo "$VERSION_CODENAME")
  sources=$(debian_sources)
  mirror=$(awk -v suite="$suite" '$3 == suite { print $2; exit }' <<<"$sources")
  mkdir -p "$roots"
  rm -rf --one-file-system "$DEBIAN_ROOT" "$roots/$name.packages"
  log=$roots/$name.log
  if ! debootstrap --variant=minbase "$suite" "$DEBIAN_ROOT" ${mirror:+"$mirror"} >"$log" 2>&1; then
    echo "root: debootstrap failed:" >&2
    tail -n 20 "$log" >&2
    return 1
  fi
  echo "$sources" >"$DEBIAN_ROOT/etc/apt/sources.list"
  # How this machine reaches them.
  apt-config dump | grep '^Acquire::' >"$DEBIAN_ROOT/etc/apt/apt.conf.d/90machine" || true
  echo 'Acquire::Languages "none";' >>"$DEBIAN_ROOT/etc/apt/apt.conf.d/90machine"
  # No service is started while packages are put in.
  printf '#!/bin/sh\nexit 101\n' >"$DEBIAN_ROOT/usr/sbin/policy-rc.d"
  chmod 755 "$DEBIAN_ROOT/usr/sbin/policy-rc.d"
  if ! unshare --mount --propagation private bash -euo pipefail -c '
    . "$1"; root=$2; shift 2
    cp /etc/resolv.conf "$root/etc/resolv.conf"
    [[ -z ${FOREIGN:-} ]] || in_root "$root" dpkg --add-architecture "$FOREIGN"
    in_root "$root" apt-get update
    in_root "$root" env DEBIAN_FRONTEND=noninteractive apt-get upgrade -y
    (($# == 0)) || in_root "$root" env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@"
    in_root "$root" apt-get clean' root "${BASH_SOURCE[0]}" "$DEBIAN_ROOT" "$@" >>"$log" 2>&1; then
    echo "root: its packages cannot be installed:" >&2
    tail -n 20 "$log" >&2
    return 1
  fi
  rm "$DEBIAN_ROOT/usr/sbin/policy-rc.d"
  echo "$*" >"$roots/$name.packages"
}

# The device files that every program may expect, and no others.
root_devices() {
  local dev=$1/dev node
  mount -t tmpfs -o mode=755 devices "$dev"
  for node in "null 1 3" "zero 1 5" "full 1 7" "random 1 8" "urandom 1 9" "tty 5 0"; do
    # shellcheck disable=SC2086
    set -- $node
    mknod -m 666 "$dev/$1" c "$2" "$3"
  done
  mkdir "$dev/pts" "$dev/shm"
  mount -t devpts -o newinstance,ptmxmode=0666,mode=620,gid=5 devpts "$dev/pts"
  mount -t tmpfs -o mode=1777 shm "$dev/shm"
  ln -s pts/ptmx "$dev/ptmx"
  ln -s /proc/self/fd "$dev/fd"
  ln -s /proc/self/fd/0 "$dev/stdin"
  ln -s /proc/self/fd/1 "$dev/stdout"
  ln -s /proc/self/fd/2 "$dev/stderr"
}

in_root() {
  local root=$1
  shift
  mountpoint -q "$root/dev" || root_devices "$root"
  unshare --mount --pid --fork --kill-child bash -euo pipefail -c '
    root=$1; shift
    mount -t proc proc "$root/proc"
    mount -t sysfs -o ro sysfs "$root/sys"
    exec env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 LC_ALL=C.UTF-8 chroot "$root" "$@"' root "$root" "$@"
}
