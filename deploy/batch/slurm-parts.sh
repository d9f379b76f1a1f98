#!/bin/bash
#SBATCH --job-name=plenalign-study-parts
#SBATCH --comment="one part of a study's Monte Carlos"
#SBATCH --array=1-8
#SBATCH --cpus-per-task=4
#SBATCH --mem=4G
#SBATCH --time=04:00:00
#SBATCH --requeue
#SBATCH --output=%x-%A_%a.log
#SBATCH --open-mode=append
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

# However many lines it has, and however they end.
study_args=()
while IFS=$' \t\r' read -ra words; do study_args+=("${words[@]}"); done <<<"${STUDY_ARGS:-}"
for word in "${study_args[@]}"; do
  case ${word%%=*} in
    --set | --config) instead="the merge has to know the configuration, too: it goes into the file CONFIG" ;;
    --out) instead="the merge has to know the folder, too: it is OUT" ;;
    --shard) instead="the array says which part each task is" ;;
    *) continue ;;
  esac
  echo "slurm-parts: ${word%%=*} in STUDY_ARGS: $instead" >&2
  exit 2
done
if [[ -n ${SHARDS:-}${FIRST:-} ]]; then
  : "${SHARDS:?how many parts there are, such as SHARDS=8: it goes with FIRST}"
  : "${FIRST:?the index of the first part, FIRST=0 or FIRST=1: it goes with SHARDS}"
  if [[ ! $SHARDS =~ ^[1-9][0-9]{0,8}$ || ! $FIRST =~ ^[01]$ ]]; then
    echo "slurm-parts: SHARDS is \"$SHARDS\" and FIRST \"$FIRST\": they are the number of parts, such as 8, and 0 or 1" >&2
    exit 2
  fi
  # As in the array that has all the parts.
  export SLURM_ARRAY_TASK_COUNT=$SHARDS SLURM_ARRAY_TASK_STEP=1
  export SLURM_ARRAY_TASK_MIN=$FIRST SLURM_ARRAY_TASK_MAX=$((FIRST + SHARDS - 1))
fi
if [[ -n ${SLURM_ARRAY_TASK_ID:-} ]]; then
  # For squeue; what it shows is no reason not to work. By the array's number: the last task's own is that of all.
  part="index $SLURM_ARRAY_TASK_ID of ${SLURM_ARRAY_TASK_MIN:-?}-${SLURM_ARRAY_TASK_MAX:-?}"
  scontrol update JobId="${SLURM_ARRAY_JOB_ID:-?}_$SLURM_ARRAY_TASK_ID" Comment="part of a study, $part, into ${OUT:-study}" || true
fi

# In this shell's place, so that it gets the signal at the time limit.
exec plenalign study ${CONFIG:+--config "$CONFIG"} --out "${OUT:-study}" --shard slurm "${study_args[@]}"
