#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# `gnomon effects` on rendered scenes: effects that nothing calls for trace nothing and change nothing, rays of the driver are
# judged, deep rays are pink, a driver that is wrong is told so.
# usage: render.sh GNOMON LAYER_FOLDER
set -eu
gnomon=$1
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
passed=0 failed=0

# want NAME EXIT PATTERN COMMAND...: the command ends so and prints a line that matches.
want() {
    name=$1 status=$2 pattern=$3
    shift 3
    got=0
    "$@" > "$out/text" 2>&1 || got=$?
    if [ "$got" = "$status" ] && grep -q -- "$pattern" "$out/text"; then
        passed=$((passed + 1))
    else
        failed=$((failed + 1))
        echo "FAILED $name: expected exit $status and a line with '$pattern', got exit $got and"
        cat "$out/text"
    fi
}
effects() { "$gnomon" effects "$@" --width 48 --height 36 --samples 4 --runs 1 --no-curves --out "$out/page"; }

want 'a landscape calls for hard shadows' 0 '^hard-shadows *yes *[1-9]' effects landscape --driver none
want 'and for no reflection' 0 '^reflection *no *0 .*the same' effects landscape --driver none
want 'the forest has holes' 0 '^transparency *yes *[1-9]' effects forest --driver none
want 'and spheres' 0 '^procedural *yes *[1-9]' effects forest --driver none
want 'glass parts colours' 0 '^dispersion *yes *[1-9]' effects cubes --driver none
want 'every ray of the driver is exact' 0 'rays judged, \([0-9,]*\) exact$' effects cubes
want 'through pipelines, too' 0 'rays judged, \([0-9,]*\) exact$' effects forest --backend pipeline
want 'the page has three pictures' 0 '^3$' grep -c 'data:image/png' "$out/page/effects.html"
want 'no depth, all pink' 0 '^0 rays, .*; 1,728 not traced' effects cubes --driver none --depth 0
want 'one level, rays that would go on are pink' 0 '[1-9][0-9,]* not traced' effects cubes --driver none --depth 1
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n' > "$out/model.obj"
want 'a model from a file' 0 'rays judged, \([0-9,]*\) exact$' effects --light "$out/model.obj"
want 'a wrong driver is told so' 1 'fail: .* rays wrong' env GNOMON_FAULT=transform.translation \
    VK_INSTANCE_LAYERS=VK_LAYER_GNOMON_faulty VK_ADD_LAYER_PATH="$2" "$gnomon" effects forest --width 48 --height 36 --runs 1 \
    --no-curves --out "$out/wrong"
want 'samples' 2 'expected a power of two' effects cubes --samples 3
echo "$passed passed, $failed failed"
[ "$failed" = 0 ]
