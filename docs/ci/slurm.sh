#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Slurm: the suite as a job array, one shard a task, and a job behind it that joins them.
#
#   slurm.sh SHARDS OUT [OPTION...]      OPTIONs are those of `gnomon run`: --driver, --expect, filters
#
# GNOMON names the program (default: ./gnomon), a clone's or a bundle's, on a disk that all nodes share, as OUT has to be. A task whose node
# dies is queued again and goes on where it was. Prints the ids of both jobs; `sbatch` options go into SBATCH_* variables.
set -eu
[ $# -ge 2 ] || { echo "usage: slurm.sh SHARDS OUT [OPTION...]" >&2; exit 2; }
shards=$1 out=$2
shift 2
case $shards in '' | *[!0-9]* | 0*) echo "slurm.sh: expected the number of shards, found '$shards'" >&2; exit 2 ;; esac
gnomon=$(readlink -f "${GNOMON:-./gnomon}")
mkdir -p "$out"
out=$(readlink -f "$out")

quote() { for word; do printf " '%s'" "$(printf %s "$word" | sed "s/'/'\\\\''/g")"; done; }
expects=$(previous=; for word; do
    case $previous$word in --expect=*) quote "$word" ;; esac
    [ "$previous" != --expect ] || quote --expect "$word"
    previous=$word
done)

array=$(sbatch --parsable --requeue --job-name=gnomon --array="1-$shards" --output="$out/shard-%a.log" --open-mode=append <<EOF
#!/bin/sh
resume=
[ -s "$out/shard-\$SLURM_ARRAY_TASK_ID/run.json" ] && resume=--resume
"$gnomon" run --shard "\$SLURM_ARRAY_TASK_ID/$shards" --out "$out/shard-\$SLURM_ARRAY_TASK_ID" --jobs "\${SLURM_CPUS_ON_NODE:-1}" \$resume$(quote "$@")
status=\$?
# 1 is a verdict, 4 a shard without a case that applies; the joined result tells.
[ \$status = 1 ] || [ \$status = 4 ] || exit \$status
exit 0
EOF
)
join=$(sbatch --parsable --job-name=gnomon-join --dependency="afterok:${array%%;*}" --kill-on-invalid-dep=yes --output="$out/join.log" <<EOF
#!/bin/sh
exec "$gnomon" merge$(n=1; while [ "$n" -le "$shards" ]; do quote "$out/shard-$n"; n=$((n + 1)); done) --out "$out/joined"$expects
EOF
)
echo "shards: job ${array%%;*}, joined by job ${join%%;*}; report: $out/joined/report.html"
