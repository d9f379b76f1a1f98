#!/usr/bin/env bash
# The page in a real browser, against the real program.
#
#   e2e/run.sh           every file
#   e2e/run.sh NAME...   those files
set -euo pipefail
cd "$(dirname "$0")/.."

(($# > 0)) || set -- align bench sign-in design states faults speed
for name in "$@"; do
  node "e2e/$name.mjs"
done
