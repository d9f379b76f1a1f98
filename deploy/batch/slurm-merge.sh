#!/bin/bash
#SBATCH --job-name=plenalign-study-merge
#SBATCH --comment="the report of a study's merged parts"
#SBATCH --cpus-per-task=4
#SBATCH --mem=4G
#SBATCH --time=04:00:00
#SBATCH --output=%x-%j.log
#
# Puts the parts of slurm-parts.sh together and writes the study's report beside them: to be submitted with a dependency on
# that array, and with the same CONFIG and OUT. docs/study.md says how.
set -euo pipefail

# A thread for each processor that it is given, unless it is told otherwise.
export RAYON_NUM_THREADS=${RAYON_NUM_THREADS:-${SLURM_CPUS_PER_TASK:-0}}
exec plenalign study merge ${CONFIG:+--config "$CONFIG"} --out "${OUT:-study}"
