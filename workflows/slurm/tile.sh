#!/usr/bin/env bash
# One tile of a plan as a task of a Slurm job array; workflows/slurm/submit.sh sends it.
#SBATCH --job-name=sizeup-tile
#SBATCH --requeue
#SBATCH --time=04:00:00
set -uo pipefail
"${SIZEUP:-sizeup}" tiles run "$1" --tile "$SLURM_ARRAY_TASK_ID" --threads "${SLURM_CPUS_PER_TASK:-1}"
code=$?
# 5: done, and some buildings or photos have no result.
[ "$code" -eq 5 ] || exit "$code"
