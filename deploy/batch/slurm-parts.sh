#!/bin/bash
#SBATCH --job-name=plenalign-study-parts
#SBATCH --array=1-8
#SBATCH --cpus-per-task=4
#SBATCH --mem=4G
#SBATCH --time=04:00:00
#SBATCH --output=%x-%A_%a.log
#
# The study's Monte Carlos in parts, as a Slurm array: each task works out one part and leaves it in a folder that all of
# them share. slurm-merge.sh puts the parts together. docs/study.md says how both are submitted.
#
#   STUDY_ARGS    what every part is told, e.g. "--seed 1 --benches 400 --assemblies 2000000"
#   CONFIG        the configuration file, the same for the merge; without it the reference preset
#   OUT           the study's folder (study)
#   SHARDS, FIRST how many parts there are and the index of the first one, where the array is not all of them: to do
#                 parts 3 and 7 of 8 again, SHARDS=8 FIRST=1 sbatch --array=3,7 slurm-parts.sh
set -euo pipefail

if [[ -z ${SLURM_ARRAY_TASK_ID:-} ]]; then
  echo "slurm-parts: not a task of an array; submit it: sbatch --array=1-8 slurm-parts.sh" >&2
  exit 2
fi
shards=${SHARDS:-$SLURM_ARRAY_TASK_COUNT}
# An array may be counted from 0 or from 1, and parts are counted from 1.
number=$((SLURM_ARRAY_TASK_ID - ${FIRST:-$SLURM_ARRAY_TASK_MIN} + 1))
read -ra study_args <<<"${STUDY_ARGS:-}"

exec plenalign study ${CONFIG:+--config "$CONFIG"} --out "${OUT:-study}" --shard "$number/$shards" "${study_args[@]}"
