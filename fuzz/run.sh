#!/usr/bin/env bash
# Coverage-guided fuzzing of every reader.
#   fuzz/run.sh                  60 seconds for each reader
#   fuzz/run.sh 10               as continuous integration does
#   fuzz/run.sh 3600             an hour for each
#   fuzz/run.sh 600 las exr      ten minutes for some
# First the seeds: one that its reader refuses teaches little, so it counts as a fault (SEEDS_MAY_FAIL lists exceptions).
# A find (panic, overflow, 10 s, 1 GB) ends that reader and lies in fuzz/finds/READER; it is read again by
#   READER=las fuzz/target/debug/readers fuzz/finds/las/crash-…
# What was learnt stays in fuzz/corpus, which a longer run goes on from.
set -eu
cd "$(dirname "$0")/.."
# Readers whose seeds are refused as they should be.
SEEDS_MAY_FAIL=""
seconds=${1:-60}
[ $# -gt 0 ] && shift
readers=("$@")
if [ ${#readers[@]} -eq 0 ]; then
    mapfile -t readers < <(sed -n '/^const READERS/,/^];/s/^    ("\([a-z0-9_]*\)", .*/\1/p' fuzz/src/readers.rs)
fi
# Files in memory, in a folder of this run: others may run beside it.
PLACE=$(mktemp -d "$([ -d /dev/shm ] && echo /dev/shm || echo "${TMPDIR:-/tmp}")/sizeup-fuzz-XXXXXX")
export PLACE
trap 'rm -rf "$PLACE"' EXIT
clean() { rm -rf "${PLACE:?}"/*; }
RUSTC_WRAPPER="$PWD/fuzz/instrument.sh" ${CARGO:-cargo} build --quiet --manifest-path fuzz/Cargo.toml
SEEDS=fuzz/corpus fuzz/target/debug/readers
failed=0
for reader in "${readers[@]}"; do
    mkdir -p "fuzz/corpus/$reader" "fuzz/finds/$reader"
    [[ " $SEEDS_MAY_FAIL " == *" $reader "* ]] && continue
    log="fuzz/finds/$reader.seeds.log"
    if ! compgen -G "fuzz/corpus/$reader/seed*" > /dev/null; then
        echo "$reader: no seed"
        failed=1
    elif ! SOUND=1 READER=$reader fuzz/target/debug/readers "fuzz/corpus/$reader"/seed* > "$log" 2>&1; then
        echo "$reader: a seed is refused: $(grep -m1 -A1 'panicked at' "$log" | tail -1)"
        failed=1
    fi
    clean
done
for reader in "${readers[@]}"; do
    dictionary=text length=16384
    case $reader in
        *gpkg) dictionary=binary length=131072 ;; # SQLite begins with 98 kB
        colmap_binary|*_zip|photo*|*png|*tiff|dtm|npy|npz|pfm|exr|kept_prior|onnx|la[sz]|*fgb|osm_pbf|sh[px]|dbf) dictionary=binary ;;
    esac
    log="fuzz/finds/$reader.log"
    status=0
    READER=$reader fuzz/target/debug/readers "fuzz/corpus/$reader" -max_total_time="$seconds" -timeout=10 \
        -rss_limit_mb=1024 -dict="fuzz/dictionaries/$dictionary.dict" -artifact_prefix="fuzz/finds/$reader/" \
        -print_final_stats=1 -max_len=$length > "$log" 2>&1 || status=$?
    count=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    speed=$(sed -n 's/^stat::average_exec_per_sec: *//p' "$log")
    memory=$(sed -n 's/^stat::peak_rss_mb: *//p' "$log")
    printf '%-20s %10s inputs %7s per second %5s MB %s\n' "$reader" "${count:-?}" "${speed:-?}" "${memory:-?}" \
        "$([ $status -eq 0 ] && echo sound || echo "FIND, see $log")"
    [ $status -eq 0 ] || failed=1
    clean
done
exit $failed
