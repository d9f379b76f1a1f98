#!/usr/bin/env bash
# Runs the commands of the pages in docs/ as they stand there, and compares what each prints with what its page says.
#
#   tests/docs/run.sh [PAGE]...     all of them, or docs/curl.md for one
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

build_daemon
exec python3 run.py "$root" "$@"
