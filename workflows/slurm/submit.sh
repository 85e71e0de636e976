#!/usr/bin/env bash
# A city on Slurm without any engine: plan here, the tiles as a job array, the merge after them.
#
#   workflows/slurm/submit.sh sizeup.toml city [options of sbatch, such as --partition=batch --cpus-per-task=2]
#
# Sent again, it runs only what is missing, stale or failed. SIZEUP names the program, CUT holds options of `sizeup tiles plan`
# (how the city is cut, and what 3D Tiles make of heights). A tile may take four hours, unless --time says otherwise.
set -euo pipefail
run=$1 city=$(realpath -m "$2")
shift 2
here=$(cd "$(dirname "$0")" && pwd)
sizeup=${SIZEUP:-sizeup}
# shellcheck disable=SC2086 # CUT holds several words
"$sizeup" tiles plan "$run" --output "$city" ${CUT:-}
# Only what is not done is sent: "number name buildings views memory state", a line for each tile.
todo=$("$sizeup" tiles status "$city" --todo --quiet)
mkdir -p "$city/logs"
after=()
if [ -n "$todo" ]; then
  numbers=$(cut -f1 <<<"$todo" | paste -sd,)
  # One array has one size: that of the largest tile.
  memory=$(awk -F'\t' '{ if ($5 + 0 > most) most = $5 + 0 } END { print most }' <<<"$todo")
  array=$(sbatch --parsable --array="$numbers" --mem="${memory}M" --output="$city/logs/%a.log" --export=ALL "$@" \
    "$here/tile.sh" "$city")
  # afterany: tiles that failed are named by the merge, which then tells how to go on.
  after=("--dependency=afterany:$array")
fi
sbatch --parsable "${after[@]}" --output="$city/logs/merge.log" --export=ALL --time=04:00:00 "$@" \
  --job-name=sizeup-merge --wrap="'$sizeup' tiles merge '$city' || [ \$? -eq 5 ]"
