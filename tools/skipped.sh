#!/usr/bin/env bash
# Tells which tests of the last run were skipped, and why: tests/it/skipped.rs writes the list.
set -euo pipefail
cd "$(dirname "$0")/.."
list="${CARGO_TARGET_DIR:-target}/tmp/skipped.txt"
if [ ! -s "$list" ]; then
    echo "no test was skipped"
    exit
fi
sort -u "$list" | awk -F '\t' '
    { n++; count[$1]++; names[$1] = names[$1] "\n      " $2 }
    END {
        print n " tests were skipped:"
        for (reason in count) print "  " count[reason] "  " reason names[reason]
    }'
