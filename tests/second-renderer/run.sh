#!/usr/bin/env bash
# The second renderer held against published numbers, against the referee's frames, and against its own fixtures.
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

python_environment second-renderer
OPENBLAS_NUM_THREADS=1 "$root/target/second-renderer/bin/python" check.py
