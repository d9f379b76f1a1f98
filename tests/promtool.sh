#!/usr/bin/env bash
# The metrics read and judged by Prometheus' own tool. It is taken out of Debian's package: installed, that would have a
# Prometheus server running here.
set -euo pipefail
cd "$(dirname "$0")"
. ./daemon.sh

folder=$root/target/promtool
promtool=$folder/usr/bin/promtool
if [[ ! -x $promtool ]]; then
  echo "promtool: unpacking Debian's package prometheus"
  rm -rf "$folder"
  mkdir -p "$folder"
  cd "$folder"
  if ! apt-get download prometheus >log 2>&1; then
    as_root=()
    [[ $(id -u) == 0 ]] || as_root=(sudo)
    "${as_root[@]}" apt-get update >log 2>&1 && apt-get download prometheus >>log 2>&1 || {
      tail -n 20 log >&2
      exit 1
    }
  fi
  dpkg-deb --fsys-tarfile prometheus_*.deb | tar --extract ./usr/bin/promtool
  rm prometheus_*.deb
fi

build_daemon
start_daemon
ask() { curl --silent --show-error --fail --header "authorization: Bearer $PLENALIGN_TOKEN" "$@"; }
# Something of everything that is counted only once it has happened.
ask --output /dev/null "$ADDRESS/api/v1/snapshot.jpg"
ask --output /dev/null --request POST "$ADDRESS/api/v1/stop"
ask --output /dev/null --request DELETE "$ADDRESS/api/v1/stop"
ask --output /dev/null "$ADDRESS/api/v1/stream.mjpg" --max-time 2 || [[ $? == 28 ]]
key=$(ask --json '{"owner":"promtool"}' "$ADDRESS/api/v1/lease" | sed -n 's/.*"key":"\([^"]*\)".*/\1/p')
ask --output /dev/null --header "Plenalign-Lease: $key" --json '{"kind":"homing"}' "$ADDRESS/api/v1/jobs"
for _ in $(seq 100); do
  ask "$ADDRESS/metrics" >"$folder/metrics"
  grep -q '^plenalign_jobs_total{' "$folder/metrics" && break
  sleep 0.2
done
for metric in stop_latency_seconds http_request_seconds picture_latency_seconds \
  jobs_total frame_age_seconds viewers axis_position_metres picture_encoder_info; do
  grep -q "^plenalign_$metric" "$folder/metrics" || {
    echo "promtool: there is no plenalign_$metric" >&2
    exit 1
  }
done
"$promtool" check metrics <"$folder/metrics"
