#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The fuzzer at work on a driver with a planted fault: it finds it, names what it needs, reduces it to a file that
# `gnomon replay` explains, and does the same twice.
# usage: fuzz.sh GNOMON LAYER_FOLDER
set -eu
gnomon=$1
export VK_ADD_LAYER_PATH=$2 VK_INSTANCE_LAYERS=VK_LAYER_GNOMON_faulty
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
fuzz() { "$gnomon" run fuzz --backend query --jobs 1 --out "$out/found" "$@"; }

# What lavapipe does wrong by itself does not count.
known='--known *inactive* --known *read_back* --known *first_vertex* --known leak.*'

GNOMON_FAULT=mask.ignored want 'finds it' 1 '^ *[0-9]* *fail.masks: first' fuzz --trials 30 $known
cp "$out/text" "$out/once"
want 'one triangle or box, one instance, one ray are left' 0 '^1 1 1$' sh -c "
    f='$out/found/fail.masks.json'
    printf '%s %s %s\n' \$(grep -c '\"custom_index\\|\"transform\"' \$f) \$(grep -c '\"origin\"' \$f) \$(grep -c '\"triangles\"' \$f)"
GNOMON_FAULT=mask.ignored want 'replays' 1 'have no bit in common: not visible' "$gnomon" replay "$out/found/fail.masks.json"
want 'does not fail without the fault' 0 'it does not fail' "$gnomon" replay "$out/found/fail.masks.json"
GNOMON_FAULT=mask.ignored want 'the same again' 1 fail.masks fuzz --trials 30 $known
sed '$d' "$out/once" > "$out/a"
sed '$d' "$out/text" > "$out/b"
want 'word for word' 0 same sh -c "cmp '$out/a' '$out/b' && echo same"
GNOMON_FAULT=build.crash want 'a crash is put down to its scene' 1 'crash.instance_array: first' fuzz --trials 30 $known
GNOMON_FAULT=build.crash want 'and replays' 1 'ended by signal 11' "$gnomon" replay "$out/found/crash.instance_array.json"
GNOMON_FAULT=build.exit want 'so is an end without a signal' 1 'error.instance_array: first' fuzz --trials 30 $known
GNOMON_FAULT=build.exit want 'and replays' 1 'ended itself with exit status 7' "$gnomon" replay "$out/found/error.instance_array.json"
want 'nothing new without a fault' 0 ' 0 of them not known' fuzz --trials 30 $known
want 'a file that is none' 2 'not JSON\|expected' "$gnomon" replay "$0"
printf '{"scene_file": "gnomon", "program": "committed", "scene": {"blases": [{"geometries": [{"positions": [0, 0], "triangles": []}]}], "tlas": {"instances": []}}, "rays": []}' > "$out/bad.json"
want 'a scene that is not valid' 2 'positions' "$gnomon" replay "$out/bad.json"
want 'no end' 2 'expected --seconds or --trials' fuzz
echo "$passed passed, $failed failed"
[ "$failed" = 0 ]
