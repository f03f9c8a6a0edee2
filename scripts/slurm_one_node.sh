#!/usr/bin/env bash
# Slurm with one node, this machine, from Debian's packages, for any user: nothing is installed, nothing runs as root, all of it is in FOLDER.
#
#   scripts/slurm_one_node.sh start FOLDER    downloads and unpacks what is missing, starts munged, slurmctld, slurmd
#   source FOLDER/env                         sbatch, squeue, .. of this Slurm
#   scripts/slurm_one_node.sh stop FOLDER
#
# To try `plywave farm --slurm` (docs/howto/cluster.md); not for use by others: its key lies in FOLDER.
set -euo pipefail

usage() { sed -n '2,8p' "$0" | cut -c3- >&2; exit 2; }
[ $# = 2 ] || usage
mkdir -p "$2"
folder=$(cd "$2" && pwd)
root=$folder/root
# Runs a program of the unpacked packages.
libraries=$root/usr/lib/x86_64-linux-gnu
[ "$(uname -m)" = x86_64 ] || libraries=$root/usr/lib/$(uname -m)-linux-gnu
export LD_LIBRARY_PATH=$libraries/slurm-wlm:$libraries PATH=$root/usr/bin:$root/usr/sbin:$PATH SLURM_CONF=$folder/slurm.conf

stop() {
    for name in slurmd slurmctld munged; do
        [ -s "$folder/$name.pid" ] || continue
        pid=$(cat "$folder/$name.pid")
        kill "$pid" 2>/dev/null && echo "stopped $name"
        for _ in $(seq 50); do kill -0 "$pid" 2>/dev/null || break; sleep 0.1; done
        rm -f "$folder/$name.pid"
    done
}

case $1 in
stop)
    stop
    exit ;;
start) ;;
*) usage ;;
esac

if [ ! -x "$root/usr/sbin/slurmctld" ] && [ ! -x "$root/usr/sbin/slurmctld-wlm" ]; then
    mkdir -p "$folder/packages"
    packages=(slurmctld slurmd slurm-client slurm-wlm-basic-plugins munge libmunge2)
    # What these need and this machine has not.
    mapfile -t all < <(apt-get install -s --no-install-recommends "${packages[@]}" | sed -n 's/^Inst \([^ ]*\).*/\1/p')
    (cd "$folder/packages" && apt-get download -q "${all[@]:-${packages[@]}}")
    for package in "$folder"/packages/*.deb; do dpkg -x "$package" "$root"; done
fi

stop
head -c 1024 /dev/urandom >"$folder/munge.key"
chmod 600 "$folder/munge.key"
chmod 700 "$folder"
"$root/usr/sbin/munged" --key-file="$folder/munge.key" --socket="$folder/munge.socket" --pid-file="$folder/munged.pid" --log-file="$folder/munged.log" --seed-file="$folder/munge.seed" --force

host=$(hostname -s)
cat >"$SLURM_CONF" <<CONF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=26817
SlurmdPort=26818
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CredType=cred/munge
PluginDir=$libraries/slurm-wlm
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
MailProg=/bin/true
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
ReturnToService=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$(awk '/MemTotal/ { print int($2 / 1024 * 0.9) }' /proc/meminfo) State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
cat >"$folder/env" <<ENV
export SLURM_CONF=$SLURM_CONF LD_LIBRARY_PATH=$libraries/slurm-wlm:$libraries\${LD_LIBRARY_PATH:+:\$LD_LIBRARY_PATH} PATH=$root/usr/bin:\$PATH
ENV
# Jobs of an earlier start are forgotten.
rm -rf "$folder/state" "$folder/spool"
mkdir -p "$folder/state" "$folder/spool"
started() { command -v "$1-wlm" || command -v "$1"; }
"$(started slurmctld)" -c
"$(started slurmd)" -c -d "$(started slurmstepd)"
for _ in $(seq 30); do
    state=$(sinfo -h -o %T 2>/dev/null || true)
    case $state in idle|mixed|allocated) echo "Slurm runs: $(sinfo -h -o '%N, %c cores, %T'); source $folder/env"; exit ;; esac
    sleep 1
done
echo "Slurm does not start; see $folder/slurmctld.log and $folder/slurmd.log" >&2
exit 1
