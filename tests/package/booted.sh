# shellcheck shell=bash disable=SC2016,SC2034,SC2154
# The package in a system that systemd runs: in namespaces of its own, with loopback for a network. The daemon under its
# unit, an upgrade with a history and a configuration of before, crashes, removal.

init=

# Starts systemd in $root as process 1 of its own PID, network, IPC, UTS and cgroup namespace.
boot() {
  local cgroup=$work/cgroup own
  mkdir -p "$cgroup"
  mount -t cgroup2 cgroup2 "$cgroup" || fail "the kernel gives no cgroup2, in which systemd would run"
  own=$cgroup/plenalign-package-$$
  mkdir "$own"
  cleanups+=("power_off; find $own -depth -type d -exec rmdir {} + 2>/dev/null; umount $cgroup")
  mountpoint -q "$root/dev" || root_devices "$root"
  setsid bash -euo pipefail -c '
    echo $$ >"$1/cgroup.procs"
    exec unshare --mount --pid --net --uts --ipc --cgroup --fork --kill-child bash -euo pipefail -c '\''
      root=$1
      hostname bench
      mount -t proc proc "$root/proc"
      mount -t sysfs -o ro sysfs "$root/sys"
      mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
      mount -t tmpfs -o mode=755 run "$root/run"
      mount -t tmpfs -o mode=1777 tmp "$root/tmp"
      cd "$root"
      mkdir -p .before
      pivot_root . .before
      umount -l .before
      exec env -i container=plenalign-test PATH=/usr/sbin:/usr/bin:/sbin:/bin /lib/systemd/systemd --log-target=journal
    '\'' boot "$2"' boot "$own" "$root" </dev/null >"$work/boot.log" 2>&1 &
  booting=$!
  wait_for 60 up_or_ended || true
  case $(in_system systemctl is-system-running 2>/dev/null) in running | degraded) return ;; esac
  cat "$work/boot.log" >&2
  in_system systemctl --no-pager list-jobs >&2 || true
  fail "systemd does not come up"
}

up_or_ended() {
  init=$(pgrep -P "$booting" -x systemd || true)
  if [[ -n $init ]]; then
    case $(in_system systemctl is-system-running 2>/dev/null) in running | degraded) return ;; esac
  fi
  ! kill -0 "$booting" 2>/dev/null
}

power_off() {
  [[ -n $booting ]] || return 0
  # With process 1 everything in its namespaces ends.
  kill -KILL "${init:-$booting}" 2>/dev/null || true
  wait "$booting" 2>/dev/null || true
  init='' booting=''
}
booting=

in_system() {
  nsenter --target "$init" --mount --pid --net --uts --ipc --cgroup --root --wd \
    env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive "$@"
}

# What the system can be asked for a failure's sake.
system_fails() {
  in_system journalctl --no-pager -n 60 >&2 || true
  fail "$@"
}

# Waits for a command in the system to succeed: until_in SECONDS WHAT COMMAND...
until_in() {
  local seconds=$1 what=$2
  shift 2
  wait_for "$seconds" in_system "$@" >/dev/null 2>&1 || system_fails "$what: not within $seconds s"
  ok "$what"
}

apt_in_system() {
  local what=$1
  shift
  in_system apt-get -qq -y -o Dpkg::Use-Pty=0 -o Dpkg::Options::=--force-confold "$what" "$@" \
    >"$work/apt.log" 2>&1 </dev/null || {
    tail -n 30 "$work/apt.log" >&2
    system_fails "apt-get $what $* failed"
  }
}

unit() { in_system systemctl show -p "$1" --value plenalign; }
ask() { in_system curl -sS --max-time 20 "http://127.0.0.1:8080$1" "${@:2}"; }
serves() { until_in 60 "$1" curl -sSf --max-time 10 -o /dev/null http://127.0.0.1:8080/healthz; }
journal() { in_system journalctl --no-pager -o cat -u plenalign "$@"; }

# The same package as an older version, with another file in /etc/default.
older_package() {
  local folder=$work/older
  dpkg-deb -R "$deb" "$folder"
  sed -i 's/^Version: .*/Version: 0.0.9-1/' "$folder/DEBIAN/control"
  sed -i 's/^# Read by plenalign.service.*/# As the older version had it./' "$folder/etc/default/plenalign"
  (cd "$folder" && find . -type f -not -path './DEBIAN/*' -printf '%P\0' | xargs -0 md5sum >DEBIAN/md5sums)
  dpkg-deb --root-owner-group -Zgzip -z1 -b "$folder" "$root/plenalign-older.deb" >/dev/null
}

installed_under_systemd() {
  older_package
  cp "$deb" "$root/plenalign.deb"
  # What it depends on is fetched before there is no network.
  in_root "$root" apt-get -qq update
  apt_in install --no-install-recommends --download-only /plenalign.deb
  boot
  ok "systemd runs: $(in_system systemctl --version | head -n 1)"

  apt_in_system install --no-install-recommends /plenalign-older.deb
  serves "an installation starts the daemon"
  is "the service is up" "$(unit ActiveState)/$(unit SubState)" active/running
  has "the bench is simulated, and says so" "$(ask /healthz)" '"simulated":true'
  confined
  until_in 30 "the bench is ready" curl -sSf -o /dev/null http://127.0.0.1:8080/readyz
  configuration_is_written_over_the_api

  a_hardware_bench_with_an_older_history
  upgraded
  revived

  apt_in_system remove plenalign
  is "a removal stops the daemon" "$(in_system pgrep -x plenalign || true)" "$(unit_pid_of_twin)"
  in_system test -f /var/lib/plenalign/history.db || fail "a removal takes the history"
  in_system test -f /etc/plenalign/plenalign.toml || fail "a removal takes the configuration"
  ok "a removal keeps history and configuration"
  in_system systemctl stop twin
  apt_in_system purge plenalign
  for path in /var/lib/plenalign /etc/plenalign /etc/default/plenalign /etc/systemd/system/multi-user.target.wants/plenalign.service \
    /etc/systemd/system/plenalign.service; do
    in_system test ! -e "$path" -a ! -L "$path" || fail "a purge leaves $path"
  done
  ok "a purge leaves nothing"
  power_off
}

# The process as the kernel sees it, and what it may open.
confined() {
  local pid status before group
  pid=$(unit MainPID)
  status=$(in_system cat "/proc/$pid/status")
  is "it runs as its user" "$(in_system stat -c %U "/proc/$pid")" plenalign
  has "with the groups of ports and cameras" "$(in_system ps -o supgrp= -p "$pid")" '^(dialout,video|video,dialout)'
  has "without any capability" "$status" '^CapBnd:\s0+$'
  has "without a way to more" "$status" '^NoNewPrivs:\s1$'
  has "with system calls filtered" "$status" '^Seccomp:\s2$'
  is "its state is its own" "$(in_system stat -c '%U:%G %a' /var/lib/plenalign)" "plenalign:plenalign 750"
  has "the journal has its log" "$(journal)" 'serving'
  before=$(unit WatchdogTimestampMonotonic)
  fed() { [[ $(unit WatchdogTimestampMonotonic) != "$before" ]]; }
  wait_for 30 fed || system_fails "the watchdog is not fed"
  ok "the watchdog is fed"

  # From within the service's cgroup. Where a device is allowed but there is none, the kernel says another word.
  group=/sys/fs/cgroup$(unit ControlGroup)/cgroup.procs
  opens() {
    in_system test -e "/dev/$1" || in_system mknod -m 666 "/dev/$1" "${@:2}"
    in_system bash -c 'echo $$ >"$1"; : <"$2"' open "$group" "/dev/$1" 2>&1 || true
  }
  # Only what this kernel has can be allowed; of its serial ports that is ttyS.
  grep -q ' ttyS$' /proc/devices || fail "this kernel has no ttyS to try the list of devices with"
  [[ $(opens ttyS9 c 4 73) != *"not permitted"* ]] || fail "a serial port may not be opened"
  ok "a serial port may be opened"
  has "memory may not" "$(opens mem c 1 1)" 'not permitted'
  has "the kernel's log may not" "$(opens kmsg c 1 11)" 'not permitted'
  has "a disk may not" "$(opens disk b 7 0)" 'not permitted'
}

configuration_is_written_over_the_api() {
  local state changed answer
  state=$(ask /api/v1/config -D - -o /tmp/config.json | tr -d '\r' | sed -n 's/^etag: //ip')
  in_system cat /tmp/config.json >"$work/config.json"
  changed=$(jq -c '{config: .stored} | .config.assembly.clearance_mm = 0.75' "$work/config.json")
  answer=$(ask /api/v1/config -X PUT -H 'content-type: application/json' -H "if-match: $state" -d "$changed")
  is "an administrator writes the configuration over the API" "$(jq -c '.changed // .' <<<"$answer")" '["assembly.clearance_mm"]'
  has "the configuration is written where it is read" "$(in_system cat /etc/plenalign/plenalign.toml)" '^clearance_mm = 0.75'
  has "with its comments" "$(in_system cat /etc/plenalign/plenalign.toml)" '^# This bench'
}

unit_pid_of_twin() { in_system systemctl show -p MainPID --value twin; }

# Stages behind a pseudo-terminal, a camera that is not there, a job of long ago.
a_hardware_bench_with_an_older_history() {
  in_system systemctl stop plenalign
  job=$(python3 tests/package/history.py "$root/var/lib/plenalign/history-of-then.db")
  in_system bash -c 'cd /var/lib/plenalign && rm -f history.db* && mv history-of-then.db history.db && chown plenalign: history.db'
  sed -e '/^identity/d' -e 's|^port = .*|port = "/run/twin/stage"|' -e 's|^device = .*|device = "/dev/video99"|' \
    deploy/examples/zaber.toml | in_system tee /etc/plenalign/plenalign.toml >/dev/null
  in_system sed -i 's/^PLENALIGN_OPTIONS=.*/PLENALIGN_OPTIONS="--json"/' /etc/default/plenalign
  in_system systemd-run --quiet --unit twin -p User=plenalign -p RuntimeDirectory=twin \
    plenalign --config /etc/plenalign/plenalign.toml sim-stage --protocol zaber --link /run/twin/stage
  until_in 20 "a twin of the stages is there" test -e /run/twin/stage
  free_the_port
  in_system systemctl start plenalign
  serves "the daemon serves a hardware bench"
  has "the bench is no simulated one" "$(ask /healthz)" '"simulated":false'
  stages_are_connected
}

stages_are_connected() {
  until_in 40 "both axes are connected" bash -c \
    'curl -sSf http://127.0.0.1:8080/api/v1/bench | grep -o "\"connected\":true" | wc -l | grep -qx 2'
}

upgraded() {
  local before sums mark
  sums=$(in_system md5sum /etc/plenalign/plenalign.toml /etc/default/plenalign)
  before=$(unit MainPID)
  mark=$(in_system date +%s)
  sleep 1
  apt_in_system install --no-install-recommends /plenalign.deb
  is "the upgrade is there" "$(in_system dpkg-query -W -f='${Version}' plenalign)" "$(dpkg-deb -f "$deb" Version)"
  serves "an upgrade starts the daemon again"
  [[ $(unit MainPID) != "$before" ]] || fail "an upgrade leaves the old program running"
  has "its axes were stopped before" "$(journal --since "@$mark")" 'focus axis: stopped, and the controller says'
  is "edited configuration files are kept" "$(in_system md5sum /etc/plenalign/plenalign.toml /etc/default/plenalign)" "$sums"
  has "what the newer version would have is beside" "$(in_system cat /etc/default/plenalign.dpkg-dist)" 'Read by plenalign.service'
  is "its tables are brought up to date" "$(python3 tests/package/history.py --version "$root/var/lib/plenalign")" \
    "$(python3 tests/package/history.py --newest)"
  is "the older history is listed by the daemon" "$(ask "/api/v1/jobs/$job" | jq -r '"\(.id) \(.state) \(.iterations | length)"')" \
    "$job converged 1"
  is "and by the command" \
    "$(in_system runuser -u plenalign -- plenalign jobs list --json | jq -r '[.. | .id? // empty] | index("'"$job"'") != null')" true
  stages_are_connected
}

# A serial port is free again when whoever held it has been killed; a pseudo-terminal stays its holder's alone for as long
# as its other end is open, and root has to set it free.
free_the_port() {
  python3 - "/proc/$init/root$(in_system readlink /run/twin/stage)" <<'PYTHON' &
import fcntl, os, sys, termios, time
for _ in range(30000):
    try:
        port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError:
        break
    fcntl.ioctl(port, termios.TIOCNXCL)
    os.close(port)
    time.sleep(0.01)
PYTHON
  cleanups+=("kill $! 2>/dev/null")
}

# What ends by itself, or hangs, is started again, and the axes are stopped meanwhile.
revived() {
  local before
  before=$(unit MainPID)
  in_system kill -KILL "$before"
  until_in 30 "a killed daemon is started again" bash -c \
    'pid=$(systemctl show -p MainPID --value plenalign); [ "$pid" != 0 ] && [ "$pid" != '"$before"' ]'
  serves "and serves"
  before=$(unit MainPID)
  in_system kill -STOP "$before"
  until_in 60 "one that hangs is started again by the watchdog" bash -c \
    'pid=$(systemctl show -p MainPID --value plenalign); [ "$pid" != 0 ] && [ "$pid" != '"$before"' ]'
  serves "and serves"
  journal >"$work/journal"
  [[ $(grep -c 'e axis: stopped, and the controller says' "$work/journal") == 3 ]] ||
    system_fails "the axes were not stopped each time: $(cat "$work/journal")"
  ok "each time its axes were stopped"
}
