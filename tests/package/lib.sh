# shellcheck shell=bash disable=SC2016,SC2034,SC2154
# What the parts of the packages' test share; sourced by run.sh, as root, in a mount namespace of its own.

# Programs of the systems that packages are installed in, beside what Debian's smallest has:
#   systemd, systemd-sysv, udev   the booted one's
#   man-db, groff   render the manual (man-db's own groff-base has no warnings of tables)
#   bash-completion, zsh, fish    load the completions
#   curl            asks the daemon
#   umockdev        shows udev devices that are not there
system_packages=(systemd systemd-sysv udev dbus man-db bash-completion zsh fish curl umockdev procps)
times=()
work=$(mktemp -d "${TMPDIR:-/tmp}/plenalign-package.XXXXXX")
# Ends everything that was started: processes first, then the folders; mounts go with the namespace.
cleanups=("rm -rf --one-file-system $work")
clean_up() {
  local status=$? index
  trap - EXIT
  set +e
  for ((index = ${#cleanups[@]} - 1; index >= 0; index--)); do
    eval "${cleanups[index]}"
  done
  exit "$status"
}
trap clean_up EXIT
trap 'exit 130' INT TERM

# part NAME COMMAND...
part() {
  local name=$1 start=$SECONDS
  shift
  echo "package: == $name"
  # Not in a condition: `set -e` holds inside.
  "$@"
  times+=("$(printf '%6d s  %s' $((SECONDS - start)) "$name")")
}

all_passed() {
  printf '%s\n' "${times[@]}"
  echo "package: all passed in $SECONDS s"
  exit 0
}

# Says what was looked at, so that the log tells what held.
ok() { echo "package:    $*"; }

# Waits for a command to succeed: wait_for SECONDS COMMAND...; fails where it does not within these.
wait_for() {
  local end=$((SECONDS + $1))
  shift
  until "$@"; do
    ((SECONDS < end)) || return 1
    sleep 0.2
  done
}

# is WHAT FOUND EXPECTED
is() {
  [[ $2 == "$3" ]] || fail "$1: '$2' instead of '$3'"
  ok "$1"
}

# has WHAT TEXT PATTERN: a grep -E pattern
has() {
  grep -qE -- "$3" <<<"$2" || fail "$1: nothing matches '$3' in: ${2:-(nothing)}"
  ok "$1"
}

lintian_finds_nothing() {
  local found
  # Pedantic and informative tags are about Debian's own archive.
  found=$(lintian --no-cfg --allow-root --fail-on none --display-level '>=warning' --show-overrides "$deb" 2>&1) ||
    fail "lintian failed: $found"
  grep -vE '^(O|N):' <<<"$found" | grep -E '.' >&2 && fail "lintian is not content"
  ok "nothing to say$(grep -q '^O:' <<<"$found" && echo ", but what is overridden with a reason: $(grep -c '^O:' <<<"$found")")"
}

roots_made() {
  debian_root smallest
  smallest=$DEBIAN_ROOT
  debian_root systemd "${system_packages[@]}"
  system=$DEBIAN_ROOT
}

# A system that nothing has been done to, over a kept one: what is done to it is gone afterwards. in_layer LOWER COMMAND...,
# with root set for it.
in_layer() {
  local lower=$1 layer
  shift
  layer=$(mktemp -d "$work/layer.XXXXXX")
  cleanups+=("mountpoint -q $layer && umount --recursive --lazy $layer")
  mount -t tmpfs -o size=2G layer "$layer"
  mkdir "$layer/upper" "$layer/work" "$layer/root"
  mount -t overlay -o "lowerdir=$lower,upperdir=$layer/upper,workdir=$layer/work" overlay "$layer/root"
  root=$layer/root
  "$@"
  umount -R "$layer/root"
  umount "$layer"
}
in_fresh_root() { in_layer "$system" "$@"; }

# Installs or removes in a system, without asking.
apt_in() {
  local what=$1
  shift
  in_root "$root" env DEBIAN_FRONTEND=noninteractive apt-get -qq -y -o Dpkg::Use-Pty=0 "$what" "$@" >"$work/apt.log" 2>&1 || {
    tail -n 30 "$work/apt.log" >&2
    fail "apt-get $what $* failed"
  }
}
