#!/usr/bin/env bash
# The Alpaca facade as ASCOM's own client for Python sees it, found by its search, in a network of its own: nothing gets
# out of it, and no other Alpaca server is there.
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

if [[ ${1:-} != inside ]]; then
  python_environment alpaca-client
  build_daemon
  own_network ./run.sh inside
fi

ip link set lo up
python=$root/target/alpaca-client/bin/python
status=0
said_alpaca() { sed -n 's/.*"alpaca":"\([^"]*\)".*/\1/p' "$daemon_folder/said"; }

start_daemon '[alpaca]' 'listen = "127.0.0.1:0"' 'lease_ttl_s = 4.0' 'discovery = true'
alpaca=$(said_alpaca)
"$python" client.py "$ADDRESS" "$alpaca" all || status=1
ids=$("$python" client.py "$ADDRESS" "$alpaca" ids)
if ((status != 0)); then
  tail -n 20 "$DAEMON_LOG" >&2
  exit "$status"
fi

# The same devices after another start, and none where nobody asked for them.
kill -TERM "$daemon_pid"
wait "$daemon_pid" || true
: >"$daemon_folder/said"
"$root/target/debug/plenalign" serve --config "$daemon_folder/plenalign.toml" --simulated --json --listen 127.0.0.1:0 \
  >"$daemon_folder/said" 2>>"$DAEMON_LOG" &
daemon_pid=$!
wait_for says_or_ended "$daemon_folder/said" "$daemon_pid"
alpaca=$(said_alpaca)
[[ $("$python" client.py "$ADDRESS" "$alpaca" ids) == "$ids" ]]
echo "- alpyca: the devices have the same identities after another start"
end_daemon
start_daemon
if grep -q alpaca "$daemon_folder/said"; then
  echo "Alpaca is spoken though nobody asked for it" >&2
  exit 1
fi
