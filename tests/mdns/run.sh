#!/usr/bin/env bash
# The daemon's announcement as another's resolver hears it, in a network of its own: nothing gets out of it.
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

if [[ ${1:-} != inside ]]; then
  python_environment mdns
  build_daemon
  own_network ./run.sh inside
fi

ip link set lo up
ip link add near type veth peer name far
ip address add 192.0.2.1/24 dev near
ip link set near up
ip link set far up
ip route add 224.0.0.0/4 dev near
resolver=("$root/target/mdns/bin/python" resolver.py)

LISTEN=192.0.2.1:8443 start_daemon
"${resolver[@]}" silent
end_daemon
LISTEN=192.0.2.1:8443 start_daemon "mdns = true"
# Our own search hears it, and finds it closed: what is announced is told no token but by TLS.
found=$("$root/target/debug/plenalign" fleet status --discover --json || true)
jq --exit-status '.daemons | length == 1 and .[0].url == "http://192.0.2.1:8443" and .[0].state == "no_access"
  and (.[0].name | startswith("Plenalign on ")) and .[0].simulated' <<<"$found" >/dev/null ||
  { echo "the daemon was not discovered: $found" >&2; exit 1; }
echo "- mdns: discovered by fleet status"
"${resolver[@]}" announced 8443 "$daemon_pid"
end_daemon
# What only this machine reaches is announced to nobody.
start_daemon "mdns = true"
"${resolver[@]}" silent
grep -q "server.mdns: not announced" "$DAEMON_LOG"
