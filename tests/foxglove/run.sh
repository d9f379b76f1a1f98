#!/usr/bin/env bash
# The live bridge as Foxglove's own client library sees it, which reads the messages by the schemas that the bridge sends.
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

client=$root/target/foxglove-client
mkdir -p "$client"
if ! cmp -s package.json "$client/package.json"; then
  echo "foxglove: installing $(grep -o '"@\?[a-z/-]*": "[0-9.]*"' package.json | paste -sd' ')"
  cp package.json "$client/package.json"
  (cd "$client" && npm install --silent --no-audit --no-fund --no-package-lock) || {
    rm -f "$client/package.json"
    exit 1
  }
fi
cp client.mjs "$client/client.mjs"
build_daemon
# A section of its own, after the keys of [server].
start_daemon '[foxglove]' 'listen = "127.0.0.1:0"'
bridge=$(sed -n 's/.*"foxglove":"\([^"]*\)".*/\1/p' "$daemon_folder/said")
status=0
node "$client/client.mjs" "$bridge" "$ADDRESS" || status=1
if ((status != 0)); then
  tail -n 20 "$DAEMON_LOG" >&2
fi
exit "$status"
