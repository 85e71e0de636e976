#!/usr/bin/env bash
# A real Slurm on this machine alone, for as long as a test lasts: munged, slurmctld and slurmd with their own keys, sockets
# and ports, everything below one folder.
#
#   tests/slurm/start.sh FOLDER [CPUS [MEMORY_MB]]    starts it and returns; FOLDER/slurm.conf is what SLURM_CONF
#                                                     must name, and FOLDER/bin goes first on the PATH
#   tests/slurm/stop.sh FOLDER                        ends it
#
# Needs slurm-wlm and munge (Debian's names).
set -euo pipefail
folder=$(realpath -m "$1") cpus=${2:-2} memory=${3:-4000}
export PATH=$PATH:/usr/sbin
for program in munged slurmctld slurmd sbatch; do
  command -v "$program" >/dev/null || { echo "no $program here" >&2; exit 69; }
done
mkdir -p "$folder"/{state,spool,log}
chmod 755 "$folder"
head -c 128 /dev/urandom >"$folder/munge.key"
chmod 600 "$folder/munge.key"
host=$(hostname -s) user=$(id -un)
# Two ports that are free now.
read -r control daemon < <(python3 -c '
import socket
held = [socket.socket() for _ in range(2)]
for s in held: s.bind(("", 0))
print(*(s.getsockname()[1] for s in held))')
cat >"$folder/slurm.conf" <<CONF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$control
SlurmdPort=$daemon
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CredType=cred/munge
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldLogFile=$folder/log/slurmctld.log
SlurmdLogFile=$folder/log/slurmd.log
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=2,bf_interval=2,batch_sched_delay=0
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
ReturnToService=2
MinJobAge=3600
MaxArraySize=10001
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cpus Boards=1 SocketsPerBoard=1 CoresPerSocket=$cpus ThreadsPerCore=1 RealMemory=$memory State=UNKNOWN
PartitionName=batch Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
# Nothing here uses control groups, but old daemons insist on a plugin for them.
version=$(slurmd -V | sed -n 's/[^0-9]*\([0-9]*\)\..*/\1/p')
if [ "${version:-0}" -ge 24 ]; then plugin=disabled; else plugin=cgroup/v1; fi
printf 'CgroupPlugin=%s\nCgroupAutomount=no\n' "$plugin" >"$folder/cgroup.conf"
export SLURM_CONF=$folder/slurm.conf
# Snakemake's job steps lose every SLURM_… of their environment, also where the settings are: an `srun` that knows.
mkdir -p "$folder/bin"
printf '#!/bin/sh\nSLURM_CONF=%s exec %s "$@"\n' "$SLURM_CONF" "$(command -v srun)" >"$folder/bin/srun"
chmod +x "$folder/bin/srun"
munged --force --key-file="$folder/munge.key" --socket="$folder/munge.socket" --pid-file="$folder/munged.pid" \
  --log-file="$folder/log/munged.log" --seed-file="$folder/munge.seed"
slurmctld -c -f "$folder/slurm.conf"
slurmd -f "$folder/slurm.conf" -N "$host"
for _ in $(seq 60); do
  if sinfo --noheader --format=%T 2>/dev/null | grep -q idle; then exit 0; fi
  sleep 0.5
done
echo "Slurm did not come up:" >&2
for log in "$folder"/log/*.log; do tail -n 20 "$log"; done >&2
"$(dirname "$0")/stop.sh" "$folder"
exit 1
