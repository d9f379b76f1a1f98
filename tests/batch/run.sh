#!/usr/bin/env bash
# The files for Kubernetes held against Kubernetes' own schemas, by a validator that is not ours: keys that it does not know
# are faults.
set -euo pipefail
cd "$(dirname "$0")"
. ../daemon.sh

python_environment batch
for file in "$root"/deploy/batch/kubernetes-*.yaml; do
  "$root/target/batch/bin/kubernetes-validate" --strict "$file"
done
