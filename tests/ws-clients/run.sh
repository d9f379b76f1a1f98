#!/usr/bin/env bash
# The WebSocket as clients that are not ours see it: Python's websockets, and ws of Node, which the page's own generated
# code helps to read pictures.
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

python_environment ws-clients
# The messages' description, from which Python makes its own classes.
(cd "$root/web" && node_modules/.bin/buf build ../proto --output "$root/target/ws-clients/messages.binpb")
build_daemon
start_daemon
status=0
python=("$root/target/ws-clients/bin/python" client.py "$ADDRESS" "$root/target/ws-clients/messages.binpb")
# It waits for most of its time, and nobody else takes the lease.
"${python[@]}" lease &
lease=$!
"${python[@]}" all || status=1
(cd "$root/web" && node e2e/websocket.mjs "$ADDRESS") || status=1
wait "$lease" || status=1
if ((status != 0)); then
  tail -n 20 "$DAEMON_LOG" >&2
fi
exit "$status"
