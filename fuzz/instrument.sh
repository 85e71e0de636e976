#!/usr/bin/env bash
# Compiler wrapper: sizeup and the crates that take files apart are compiled with coverage counters, all else as usual.
# The counters are LLVM's own and need no nightly compiler.
set -eu
watched=" sizeup sizeup_geo sizeup_survey sizeup_photos sizeup_footprints sizeup_results sizeup_truth readers las laz exr npyz zip quick_xml serde_json exif csv csv_core toml toml_parser cjval "
compiler=$1; shift
name=
for ((i = 1; i <= $#; i++)); do
    [ "${!i}" = --crate-name ] && { j=$((i + 1)); name=${!j}; break; }
done
if [ -n "$name" ] && [[ "$watched" == *" $name "* ]]; then
    exec "$compiler" "$@" --cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
        -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
        -Cllvm-args=-sanitizer-coverage-trace-compares
fi
exec "$compiler" "$@"
