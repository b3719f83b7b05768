#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# slurm.sh PROGRAM SOURCE: docs/ci/slurm.sh on a real Slurm, of one controller and two nodes on this host. In the middle of the job one
# node dies (its daemon and all it runs are killed); its shard is queued again, goes on, and the joined result is whole.
# By hand, as root, where Debian's slurm-wlm and munge are installed and nothing else uses them: it is not among the tests that always run.
set -u
gnomon=$(readlink -f "$1") source=$(readlink -f "$2")
scratch=$(mktemp -d) || exit 1
started=
cleanup() {
    for pid in $started; do kill -9 "$pid" 2>/dev/null; done
    rm -rf "$scratch"
}
trap cleanup EXIT
die() { printf 'FAILED: %s\n' "$*"; tail -n 20 "$scratch"/*.log 2>/dev/null; exit 1; }
for tool in slurmctld slurmd sbatch munged; do command -v $tool >/dev/null || PATH=$PATH:/usr/sbin; done
command -v slurmctld >/dev/null && command -v munged >/dev/null || die 'slurmctld and munged are not installed'

mkdir -p "$scratch/state" "$scratch/n1" "$scratch/n2" "$scratch/munge"
chmod 755 "$scratch" && chmod 700 "$scratch/munge"
head -c 1024 /dev/urandom >"$scratch/munge/key" && chmod 400 "$scratch/munge/key"
munged --force --foreground --key-file="$scratch/munge/key" --socket="$scratch/munge.socket" --pid-file="$scratch/munge.pid" \
    --log-file="$scratch/munged.log" --seed-file="$scratch/munge/seed" &
started="$started $!"
host=$(uname -n)
cat >"$scratch/slurm.conf" <<EOF
ClusterName=gnomon
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=17000
AuthType=auth/munge
AuthInfo=socket=$scratch/munge.socket
CredType=cred/munge
SlurmUser=root
SlurmdUser=root
StateSaveLocation=$scratch/state
SlurmdSpoolDir=$scratch/%n
SlurmctldPidFile=$scratch/slurmctld.pid
SlurmdPidFile=$scratch/slurmd-%n.pid
SlurmctldLogFile=$scratch/slurmctld.log
SlurmdLogFile=$scratch/slurmd-%n.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SchedulerType=sched/backfill
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdTimeout=10
InactiveLimit=0
ReturnToService=2
MpiDefault=none
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=17001 CPUs=1 State=UNKNOWN
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=17002 CPUs=1 State=UNKNOWN
PartitionName=all Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP
EOF
export SLURM_CONF="$scratch/slurm.conf"
printf 'CgroupPlugin=disabled\n' >"$scratch/cgroup.conf"
sleep 1
slurmctld -D -i >"$scratch/ctld.out" 2>&1 &
started="$started $!"
for node in n1 n2; do
    slurmd -D -N $node >"$scratch/$node.out" 2>&1 &
    eval "$node=$!"
    started="$started $!"
done
for wait in $(seq 60); do
    [ "$(sinfo -h -t idle -o %D 2>/dev/null)" = 2 ] && break
    sleep 1
done
[ "$(sinfo -h -t idle -o %D)" = 2 ] || die "the nodes do not come up: $(sinfo -N -l 2>&1)"
echo "two nodes are up after $wait s"

cd "$scratch" || exit 1
GNOMON=$gnomon sh "$source/docs/ci/slurm.sh" 4 "$scratch/out" --timeout 120 || die 'the jobs cannot be submitted'
for wait in $(seq 60); do
    lines=$(cat "$scratch"/out/shard-*/results.jsonl 2>/dev/null | wc -l)
    [ "$lines" -ge 20 ] && break
    sleep 1
done
victim=$(squeue -h -w n2 -t running -o %K | head -n 1)
[ -n "$victim" ] || die "nothing runs on n2: $(squeue)"
done_before=$(wc -l <"$scratch/out/shard-$victim/results.jsonl")
# The node dies: its daemon, the step's manager and everything below them.
kill_tree() {
    for child in $(cat "/proc/$1/task/$1/children" 2>/dev/null); do kill_tree "$child"; done
    kill -9 "$1" 2>/dev/null
}
for manager in $(pgrep -f "slurmstepd: \[.*\]"); do
    job=$(tr '\0' ' ' <"/proc/$manager/cmdline" | sed -n 's/.*\[\([0-9]*\)\..*/\1/p')
    [ "$(squeue -h -j "$job" -o %N 2>/dev/null)" = n2 ] && kill_tree "$manager"
done
kill_tree "$n2"
echo "node n2 died with shard $victim at $done_before results"
for wait in $(seq 120); do
    squeue -h -t pending,running,completing -n gnomon -o '%K %N %r' | grep -q "^$victim n2" || break
    sleep 1
done
echo "its shard is queued again after $wait s"
slurmd -D -N n2 >"$scratch/n2b.out" 2>&1 &
started="$started $!"
for wait in $(seq 600); do
    [ -z "$(squeue -h)" ] && break
    sleep 1
done
[ -z "$(squeue -h)" ] || die "jobs are left: $(squeue)"
[ -s "$scratch/out/joined/results.jsonl" ] || die "nothing was joined: $(cat "$scratch"/out/*.log)"
wanted=$("$gnomon" run --list | wc -l)
found=$(grep -v '^{"name":"summary"' "$scratch/out/joined/results.jsonl" | sed 's/.*"name":"\([^"]*\)".*/\1/' | sort -u | wc -l)
[ "$wanted" = "$found" ] || die "expected $wanted results, found $found"
now=$(head -n "$done_before" "$scratch/out/shard-$victim/results.jsonl" | grep -c '^{.*}$')
[ "$now" = "$done_before" ] || die 'results of before the death are lost'
grep -c 'cases on' "$scratch/out/shard-$victim.log" | grep -q '^[2-9]' || die "shard $victim did not run twice: $(cat "$scratch/out/shard-$victim.log")"
echo "joined: $(tail -n 1 "$scratch/out/joined/results.jsonl" | sed 's/.*"message":"\([^"]*\)".*/\1/')"
echo "all as expected"
