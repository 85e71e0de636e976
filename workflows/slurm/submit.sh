#!/usr/bin/env bash
# A city on Slurm without any engine: plan here, the tiles as job arrays, the merge after them.
#
#   workflows/slurm/submit.sh sizeup.toml city [options of sbatch, such as --partition=batch --cpus-per-task=2]
#
# Tiles of similar memory form one array. A second array tries tiles again that failed for a reason that may pass, with half
# as much memory more. Sent again, the script runs only what is missing, stale or failed. SIZEUP names the program, CUT holds
# options of `sizeup tiles plan` (how the city is cut, and what 3D Tiles make of heights). A tile may take four hours, unless
# --time says otherwise.
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

# Prints "megabytes<tab>numbers" for each array. All tasks of an array request the same memory, that of its largest tile: at
# most twice what its smallest needs.
classes() {
  cut -f1,5 <<<"$1" | sort -t$'\t' -k2,2n -k1,1n | awk -F'\t' '
    { mb = $2 + 0 }
    mb > 2 * least { if (numbers != "") print most "\t" numbers; least = mb; numbers = "" }
    { numbers = numbers (numbers == "" ? "" : ",") $1; most = mb }
    END { if (numbers != "") print most "\t" numbers }'
}

after=
if [ -n "$todo" ]; then
  while IFS=$'\t' read -r memory numbers; do
    array=$(sbatch --parsable --array="$numbers" --mem="${memory}M" --output="$city/logs/%a.log" --export=ALL "$@" \
      "$here/tile.sh" "$city")
    # It starts if a task of the first array fails, and is dropped otherwise.
    again=$(sbatch --parsable --array="$numbers" --mem="$((memory * 3 / 2))M" --output="$city/logs/%a.again.log" \
      --export=ALL --dependency="afternotok:$array" --kill-on-invalid-dep=yes "$@" "$here/tile.sh" "$city" again)
    after="$after:$array:$again"
  done < <(classes "$todo")
fi
# afterany: tiles that failed are named by the merge, which then tells how to go on.
sbatch --parsable ${after:+"--dependency=afterany$after"} --output="$city/logs/merge.log" --export=ALL --time=04:00:00 "$@" \
  --job-name=sizeup-merge --wrap="'$sizeup' tiles merge '$city' || [ \$? -eq 5 ]"
