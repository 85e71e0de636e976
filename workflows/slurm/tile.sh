#!/usr/bin/env bash
# One tile of a plan as a task of a Slurm job array; workflows/slurm/submit.sh sends it. With `again` it runs the tile only
# if another try can help.
#SBATCH --job-name=sizeup-tile
#SBATCH --requeue
#SBATCH --time=04:00:00
set -uo pipefail
city=$1
sizeup=${SIZEUP:-sizeup}
if [ "${2:-}" = again ]; then
  # 2, 3: settings and input stay what they are.
  state=$("$sizeup" tiles status "$city" --todo --quiet | awk -F'\t' -v n="$SLURM_ARRAY_TASK_ID" '$1 == n { print $6 }')
  case $state in
    "failed, exit code 2,"* | "failed, exit code 3,"*)
      echo "tile $SLURM_ARRAY_TASK_ID is not tried again: it $state" >&2
      exit "$(cut -d' ' -f4 <<<"$state" | tr -d ,)"
      ;;
  esac
fi
"$sizeup" tiles run "$city" --tile "$SLURM_ARRAY_TASK_ID" --threads "${SLURM_CPUS_PER_TASK:-1}"
code=$?
# 5: done, and some buildings or photos have no result.
[ "$code" -eq 5 ] || exit "$code"
