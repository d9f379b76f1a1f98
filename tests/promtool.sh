#!/usr/bin/env bash
# The metrics read and judged by Prometheus' own tool, and with it the dashboards and the alerts: their expressions, and
# that there is what they ask for. It is taken out of Debian's package: installed, that would have a Prometheus server
# running here.
set -euo pipefail
cd "$(dirname "$0")"
. ./daemon.sh
. ./unpack.sh

folder=$root/target/promtool
promtool=$folder/usr/bin/promtool
unpack_debian promtool usr/bin/promtool prometheus

build_daemon
# A broker that is not there: what is counted of it is there all the same.
start_daemon '[mqtt]' 'broker = "mqtt://127.0.0.1:1"'
ask() { curl --silent --show-error --fail --header "authorization: Bearer $PLENALIGN_TOKEN" "$@"; }
# Something of everything that is counted only once it has happened.
ask --output /dev/null "$ADDRESS/api/v1/snapshot.jpg"
ask --output /dev/null --request POST "$ADDRESS/api/v1/stop"
ask --output /dev/null --request DELETE --json '{"why":"a test"}' "$ADDRESS/api/v1/stop"
ask --output /dev/null "$ADDRESS/api/v1/stream.mjpg" --max-time 2 || [[ $? == 28 ]]
key=$(ask --json '{"owner":"promtool"}' "$ADDRESS/api/v1/lease" | sed -n 's/.*"key":"\([^"]*\)".*/\1/p')
ask --output /dev/null --header "Plenalign-Lease: $key" --json '{"kind":"homing"}' "$ADDRESS/api/v1/jobs"
a_job_is_counted() {
  ask "$ADDRESS/metrics" >"$folder/metrics"
  grep -q '^plenalign_jobs_total{' "$folder/metrics"
}
wait_for a_job_is_counted || true
for metric in stop_latency_seconds http_request_seconds picture_latency_seconds \
  jobs_total frame_age_seconds viewers axis_position_metres picture_encoder_info ready history_writable \
  disk_free_bytes disk_kept_free_bytes mqtt_connected mqtt_failures_total; do
  grep -q "^plenalign_$metric" "$folder/metrics" || {
    echo "promtool: there is no plenalign_$metric" >&2
    exit 1
  }
done
"$promtool" check metrics <"$folder/metrics"

# An example names files that are not here.
sed 's/^      ca_file: .*/      insecure_skip_verify: true/; s/^      credentials_file: .*/      credentials: x/' \
  "$root/deploy/prometheus/prometheus.yml" >"$folder/prometheus.yml"
cp "$root/deploy/prometheus/rules.yml" "$folder/"
"$promtool" check config "$folder/prometheus.yml" | sed '/^ *$/d'
"$promtool" test rules "$root/tests/monitoring/alerts.yml" | sed '/^ *$/d'
python3 monitoring/dashboards.py "$promtool" "$folder/metrics" "$root"
