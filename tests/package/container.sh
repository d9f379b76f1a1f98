# shellcheck shell=bash disable=SC2016,SC2034,SC2154
# The container file's steps, one after another, in a system as small as its base: there is no container engine here. What
# its instructions mean is followed for those that it has; one that is not known here is a failure.

container_file() { in_layer "$smallest" container_built_and_run; }

container_built_and_run() {
  local instruction rest user=root folder=/ entrypoint command health asked pid status
  local -a environment=() copied run
  # Docker's and Podman's own: the architecture in Debian's words.
  local TARGETARCH=$arch
  while read -r instruction rest; do
    rest=${rest//'${TARGETARCH}'/$TARGETARCH}
    case "$instruction" in
      FROM) has "its base is Debian slim, of this release" "$rest" "^debian:$(. /etc/os-release && echo "$VERSION_CODENAME")-slim$" ;;
      ARG) is "its argument is the engine's own" "$rest" TARGETARCH ;;
      COPY)
        # shellcheck disable=SC2206
        copied=("$(dirname "$deb")"/${rest% *})
        cp "${copied[@]}" "$root${rest##* }"
        ok "COPY $(basename -a "${copied[@]}" | xargs)"
        ;;
      RUN)
        [[ $user == root ]] || fail "container file: RUN after USER is not followed here"
        in_root "$root" env "${environment[@]}" sh -c "cd $folder; $rest" >"$work/container.log" 2>&1 || {
          tail -n 20 "$work/container.log" >&2
          fail "container file: RUN failed: $rest"
        }
        ok "RUN ${rest:0:60}..."
        ;;
      USER) user=$rest ;;
      WORKDIR) folder=$rest ;;
      ENV) read -ra run <<<"$rest"; environment+=("${run[@]}") ;;
      VOLUME) is "its volume is the daemon's" "$(in_root "$root" stat -c '%U %a' "$rest")" "plenalign 750" ;;
      EXPOSE) has "its port is the daemon's own" "$rest" '^8080$' ;;
      STOPSIGNAL) is "it is stopped by what the daemon takes" "$rest" SIGTERM ;;
      HEALTHCHECK) health=${rest#*CMD } ;;
      ENTRYPOINT) entrypoint=$rest ;;
      CMD) command=$rest ;;
      *) fail "container file: the instruction $instruction is not known here" ;;
    esac
  done < <(sed -e '/^#/d' -e '/^$/d' -e ':a' -e '/\\$/{N;s/\\\n *//;ba' -e '}' deploy/Containerfile)

  is "it does not run as root" "$user" plenalign
  has "its user may use ports and cameras" "$(in_root "$root" id -nG "$user")" '^plenalign dialout video$'
  [[ ! -e $root/lib/systemd/systemd ]] || fail "container file: systemd came along"
  ok "no systemd came along"
  is "nothing is left of apt" "$(find "$root/var/lib/apt/lists" "$root/tmp" -type f)" ""
  mapfile -t run < <(jq -r '.[]' <<<"$entrypoint"; jq -r '.[]' <<<"$command")
  mapfile -t asked < <(jq -r '.[]' <<<"$health")

  # As docs/install.md has it run: read-only but for /tmp and the volume, no capabilities, nothing new to be had.
  mount -t tmpfs tmp "$root/tmp"
  mount --bind "$root/var/lib/plenalign" "$root/var/lib/plenalign"
  mount -o remount,ro,bind "$root"
  mountpoint -q "$root/dev" || root_devices "$root"
  unshare --mount --pid --net --ipc --uts --fork --kill-child bash -euo pipefail -c '
    root=$1 folder=$2 user=$3; shift 3
    ip link set lo up
    mount -t proc proc "$root/proc"
    exec chroot "$root" setpriv --reuid "$user" --regid "$user" --init-groups --no-new-privs --bounding-set=-all --inh-caps=-all \
      sh -c "cd $folder; exec \"\$@\"" run "$@"' \
    contained "$root" "$folder" "$user" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin "${environment[@]}" "${run[@]}" \
    >"$work/contained.log" 2>&1 &
  pid=$!
  cleanups+=("kill -KILL $pid 2>/dev/null")
  healthy() {
    nsenter --target "$(pgrep -P "$pid" plenalign)" --net --root --wd env -i PATH=/usr/bin:/bin "${asked[@]}"
  }
  healthy_or_ended() { healthy 2>/dev/null || ! kill -0 "$pid" 2>/dev/null; }
  wait_for 60 healthy_or_ended || true
  healthy || { cat "$work/contained.log" >&2; fail "container: its health is not well"; }
  ok "its health check is content"
  kill -TERM "$(pgrep -P "$pid" plenalign)"
  status=0
  wait "$pid" || status=$?
  is "it ends by its signal, in order" "$status" 0
  has "and has kept its history in the volume" "$(ls "$root/var/lib/plenalign")" '^history.db$'
  umount "$root/tmp" "$root/var/lib/plenalign"
  mount -o remount,rw,bind "$root"
}
