#!/usr/bin/env bash
# A Slurm cluster on this machine: munged, slurmctld and the slurmd of two nodes, without systemd, on loopback only, with
# everything that they keep in a folder. It stands for as long as a command runs, which has SLURM_CONF set:
#
#   tests/slurm/cluster.sh FOLDER COMMAND...
#   tests/slurm/cluster.sh "$(mktemp -d)" bash     a shell, to look around
#
# FOLDER has slurm.conf and the logs (*.log). `slurmd -N node2` starts a node that was taken down. FULL=DIR has a file system
# of 1 MiB at DIR meanwhile, for which the script has to be root, or in a user namespace with mounts of its own.
set -euo pipefail
. "$(dirname "$0")/../daemon.sh"

if [[ -n ${FULL:-} ]]; then
  mkdir -p "$FULL"
  mount -t tmpfs -o size=1m tmpfs "$FULL"
  # Root of a user namespace may not drop its groups, as Slurm's daemons do where they are root: nobody need not.
  if [[ $(</proc/self/setgroups) == deny ]]; then
    exec env --unset=FULL unshare --map-user=65534 --map-group=65534 -- "$0" "$@"
  fi
fi
folder=$(realpath "$1")
shift
# Debian has the daemons where only root looks.
export PATH=$PATH:/usr/sbin
for tool in munged slurmctld slurmd sbatch python3; do
  command -v "$tool" >/dev/null || { echo "cluster: $tool is missing: deploy/setup.sh test installs it" >&2; exit 1; }
done

finish() {
  local file
  # Tasks first: they outlive the daemon of their node.
  scancel --user="$(id -un)" 2>/dev/null || true
  wait_for no_tasks || true
  for file in "$folder"/{node1,node2,slurmctld,munged}.pid; do
    [[ ! -s $file ]] || kill -KILL "$(<"$file")" 2>/dev/null || true
  done
  [[ -z ${FULL:-} ]] || umount "$FULL" || true
}
no_tasks() { [[ -z $(squeue --noheader 2>/dev/null) ]]; }
both_are_idle() { [[ $(sinfo --noheader --states=idle --format=%D 2>/dev/null) == 2 ]]; }

# Three ports that are free now.
read -r control one two < <(python3 - <<'PYTHON'
import socket
sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(3)]
print(*(s.getsockname()[1] for s in sockets))
PYTHON
)
export SLURM_CONF=$folder/slurm.conf
cat >"$SLURM_CONF" <<CONF
ClusterName=tests
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort=$control
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
# What is requeued waits for as long as its credential may be valid.
AuthInfo=socket=$folder/munge.socket,cred_expire=5
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/%n
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/%n.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/%n.log
# Nothing that wants cgroups.
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MailProg=/bin/true
SchedulerType=sched/backfill
SchedulerParameters=bf_interval=1,sched_min_interval=0,batch_sched_delay=0
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
# Nodes as the scripts want them, whatever this machine has.
SlurmdParameters=config_overrides
ReturnToService=2
SlurmdTimeout=5
KillWait=5
MessageTimeout=5
NodeName=DEFAULT CPUs=4 RealMemory=8192
NodeName=node1 NodeHostname=$(hostname) NodeAddr=127.0.0.1 Port=$one
NodeName=node2 NodeHostname=$(hostname) NodeAddr=127.0.0.1 Port=$two
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
mkdir -p "$folder"/{state,node1,node2}
(umask 077 && head -c 128 /dev/urandom >"$folder/munge.key")
trap finish EXIT
munged --force --key-file="$folder/munge.key" --socket="$folder/munge.socket" --pid-file="$folder/munged.pid" \
  --log-file="$folder/munged.log" --seed-file="$folder/munge.seed"
slurmctld -c
slurmd -N node1
slurmd -N node2
wait_for both_are_idle || { echo "cluster: the nodes did not come up:" >&2; tail -n 20 "$folder"/*.log >&2; exit 1; }
"$@"
