#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes every kind of HTML page, small: of a run with failures, known ones, sweeps and pictures, of a gate, of accuracy, of effects.
# usage: [GATE_TIMES=] make.sh GNOMON FOLDER
set -eu
gnomon=$1 out=$2

# may STATUS COMMAND...: ends so.
may() {
    want=$1 got=0
    shift
    "$@" > "$out/said" 2>&1 || got=$?
    [ "$got" = "$want" ] && return
    echo "expected exit $want, got exit $got from $*"
    cat "$out/said"
    exit 1
}
mkdir -p "$out"
cases='*.smoke.* query.scenes.cubes query.hit.inactive_triangles.* query.stability.count.boxes query.masks.single*'
set -f
may 1 "$gnomon" run $cases --scale 0.05 --out "$out/run"
grep ',Fail,' "$out/run/results.csv" | cut -d, -f1-2 > "$out/known.txt"
may 0 "$gnomon" run $cases --scale 0.05 --out "$out/known" --expect "$out/known.txt"
may 0 "$gnomon" run '*.smoke.*' --scale 0.05 --out "$out/right"
may 1 env GNOMON_TEST_FAULT=crash:query.smoke.quad "$gnomon" run '*.smoke.*' --scale 0.05 --out "$out/crash"
# A case that passes against what is expected of it, so that the table of changes has a row. Times take a minute: GATE_TIMES=
echo 'query.smoke.quad,Fail' > "$out/passes.txt"
may 1 "$gnomon" gate --driver lavapipe --against lavapipe '*.smoke.*' --scale 0.05 --expect "$out/passes.txt" \
    ${GATE_TIMES---no-times} --out "$out/gate"
may 0 "$gnomon" accuracy --quick --scene terrain --runs 1 --out "$out/accuracy"
may 0 "$gnomon" effects cubes --width 48 --height 36 --samples 2 --runs 1 --out "$out/effects"
