#!/usr/bin/env bash
# What the daemon publishes, as a subscriber at Mosquitto sees it, in a network of its own. Mosquitto is taken out of
# Debian's packages: installed, it would have a broker running here.
#
#   tests/mqtt/run.sh [what pytest takes]
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh
. ../unpack.sh

if [[ ${1:-} != inside ]]; then
  python_environment mqtt
  unpack_debian mosquitto usr/sbin/mosquitto mosquitto libmosquitto1 libcjson1 libdlt2 libwrap0 libnsl2 libtirpc3
  build_daemon
  own_network ./run.sh inside "$@"
fi
shift
ip link set lo up
library=$(dirname "$(find "$root/target/mosquitto" -name 'libmosquitto.so.1')")
export MOSQUITTO=$root/target/mosquitto/usr/sbin/mosquitto MOSQUITTO_LIBRARIES=$library
export MOSQUITTO_PASSWD=$root/target/mosquitto/usr/bin/mosquitto_passwd
exec env PYTHONDONTWRITEBYTECODE=1 "$root/target/mqtt/bin/pytest" -p no:cacheprovider --quiet --timeout 240 \
  --durations 5 "$@"
