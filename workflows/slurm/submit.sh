#!/usr/bin/env bash
# A city on Slurm without any engine: plan here, the tiles as a job array, the merge after them.
#
#   workflows/slurm/submit.sh sizeup.toml city [options of sbatch, such as --partition=batch --cpus-per-task=2]
#
# Sent again, it runs only what is missing. SIZEUP names the program, CUT holds options of `sizeup tiles plan`.
set -euo pipefail
run=$1 city=$(realpath -m "$2")
shift 2
here=$(cd "$(dirname "$0")" && pwd)
sizeup=${SIZEUP:-sizeup}
# shellcheck disable=SC2086 # CUT holds several words
"$sizeup" tiles plan "$run" --output "$city" ${CUT:-}
tiles=$("$sizeup" tiles status "$city" --quiet)
n=$(wc -l <<<"$tiles")
# One array has one size: that of the largest tile.
memory=$(awk -F'\t' '{ if ($4 + 0 > most) most = $4 + 0 } END { print most }' <<<"$tiles")
mkdir -p "$city/logs"
array=$(sbatch --parsable --array="0-$((n - 1))" --mem="${memory}M" --output="$city/logs/%a.log" --export=ALL "$@" \
  "$here/tile.sh" "$city")
# afterany: tiles that failed are named by the merge, which then tells how to go on.
sbatch --parsable --dependency="afterany:$array" --output="$city/logs/merge.log" --export=ALL "$@" \
  --job-name=sizeup-merge --wrap="'$sizeup' tiles merge '$city' || [ \$? -eq 5 ]"
