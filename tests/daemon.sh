# A daemon for clients that are not ours, sourced by the scripts that run them: the simulated bench on a port of its own,
# with a token demanded. `start_daemon` sets
#
#   ADDRESS         where it serves, without a slash at the end
#   PLENALIGN_TOKEN, PLENALIGN_TOKEN_ID   a token of an administrator
#   DAEMON_LOG      what it logs
#
# and ends it with the script. LISTEN has it serve elsewhere, without TLS.

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
daemon_folder=
daemon_pid=

# Goes on as a command in a network of its own: as root of a user namespace where this user may not have one otherwise.
# Whoever may needs none, and within a chroot nobody gets one.
own_network() {
  local as=()
  unshare --net true 2>/dev/null || as=(--user --map-root-user)
  exec unshare "${as[@]}" --net "$@"
}

# Installs what a folder's requirements.txt asks for into an environment of its own below target/.
python_environment() {
  local name=$1 venv=$root/target/$1
  if ! cmp -s requirements.txt "$venv/requirements.txt"; then
    echo "$name: installing $(paste -sd' ' requirements.txt)"
    rm -rf "$venv"
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check -r requirements.txt
    cp requirements.txt "$venv/requirements.txt"
  fi
}

# Waits for a command to succeed; fails where it never does.
wait_for() {
  local end=$((SECONDS + 60))
  until "$@"; do
    ((SECONDS < end)) || return 1
    sleep 0.05
  done
}

# says_or_ended FILE PROCESS: whether a program has written something, or will not any more.
says_or_ended() { [[ -s $1 ]] || ! kill -0 "$2" 2>/dev/null; }

end_daemon() {
  if [[ -n $daemon_pid ]]; then
    kill -TERM "$daemon_pid" 2>/dev/null || true
    wait "$daemon_pid" 2>/dev/null || true
    daemon_pid=
  fi
  [[ -z $daemon_folder ]] || rm -rf "$daemon_folder"
  daemon_folder=
}

# Builds the program, unless NO_BUILD says that it is there.
build_daemon() {
  [[ -z ${NO_BUILD:-} ]] || return 0
  # As the tests build it: a plain build would compile every dependency anew, without what the tests need of it.
  . "$root/tests/lints.sh"
  cargo test --quiet --no-run --test integration --manifest-path "$root/Cargo.toml"
}

# start_daemon [KEY=VALUE of [server]]...
start_daemon() {
  local plenalign=$root/target/debug/plenalign said created
  daemon_folder=$(mktemp -d)
  trap end_daemon EXIT
  DAEMON_LOG=$daemon_folder/log
  export PLENALIGN_STATE_DIR=$daemon_folder
  # As fast as it goes: every request, and every picture.
  cat >"$daemon_folder/plenalign.toml" <<'TOML'
[server]
auth = "required"
requests_per_s = 100000
TOML
  printf '%s\n' "$@" >>"$daemon_folder/plenalign.toml"
  cat >>"$daemon_folder/plenalign.toml" <<'TOML'
[sensor]
width_px = 400
height_px = 400
[bench.camera]
timeout_ms = 10000
[bench.simulation]
rays = 4
TOML
  created=$("$plenalign" token create --name tests --scope admin --json)
  PLENALIGN_TOKEN=$(sed -n 's/.*"secret":"\([^"]*\)".*/\1/p' <<<"$created")
  PLENALIGN_TOKEN_ID=$(sed -n 's/.*"id":"\([^"]*\)".*/\1/p' <<<"$created")
  export PLENALIGN_TOKEN PLENALIGN_TOKEN_ID
  said=$daemon_folder/said
  "$plenalign" serve --config "$daemon_folder/plenalign.toml" --simulated --json \
    --listen "${LISTEN:-127.0.0.1:0}" --insecure \
    >"$said" 2>"$DAEMON_LOG" &
  daemon_pid=$!
  wait_for says_or_ended "$said" "$daemon_pid" || true
  ADDRESS=$(sed -n 's/.*"address":"\([^"]*\)\/".*/\1/p' "$said")
  if [[ -z $ADDRESS ]]; then
    echo "the daemon did not start:" >&2
    cat "$DAEMON_LOG" >&2
    return 1
  fi
  # The camera's first frame takes a moment.
  wait_for curl --silent --fail --output /dev/null "$ADDRESS/readyz" && return
  echo "the daemon did not become ready:" >&2
  curl --silent "$ADDRESS/readyz" >&2
  return 1
}
