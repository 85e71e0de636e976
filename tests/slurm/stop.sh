#!/usr/bin/env bash
# Ends what tests/slurm/start.sh started in a folder, and only that.
set -uo pipefail
folder=$(realpath -m "$1")
for name in slurmd slurmctld munged; do
  pid=$(cat "$folder/$name.pid" 2>/dev/null) || continue
  kill "$pid" 2>/dev/null
done
for _ in $(seq 40); do
  alive=no
  for name in slurmd slurmctld munged; do
    pid=$(cat "$folder/$name.pid" 2>/dev/null) && readlink "/proc/$pid/exe" >/dev/null && alive=yes
  done
  [ "$alive" = no ] && exit 0
  sleep 0.25
done
