# SPDX-License-Identifier: Apache-2.0
# killed.sh GNOMON PROGRAM: what shaders recorded is told when the application was killed, and nothing is when there is nothing.
set -u
gnomon=$1 program=$2 failures=0
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
unset VK_ADD_LAYER_PATH VK_INSTANCE_LAYERS
ulimit -c 0

run() {
    "$gnomon" layer --log "$scratch/log" --sarif "$scratch/sarif" -- "$program" "$1" >"$scratch/out" 2>"$scratch/err" </dev/null
    status=$?
    [ $status = 1 ] || { failures=$((failures + 1)); echo "FAILED: $1: expected status 1, found $status"; }
}
expect() {
    found=$(grep -c -e "$3" "$2")
    [ "$found" = "$4" ] || { failures=$((failures + 1)); echo "FAILED: $1: expected $4 lines that match '$3', found $found:"; cat "$2"; }
}

run killed-wrong
expect 'a mistake' "$scratch/err" 'which died of signal 9 ' 1
expect 'a mistake' "$scratch/err" '^  error       query\.proceed\.after_false: 1 time at 1 site$' 1
expect 'a mistake' "$scratch/err" '^  not checked everything: no Vulkan instance was made with the layer, or its end was not reached$' 1
expect 'a mistake' "$scratch/log" '"rule":"query\.proceed\.after_false","severity":"error","count":1 *,.*asks\.glsl:13.*Left by process' 1
expect 'a mistake' "$scratch/sarif" '"ruleId": "query\.proceed\.after_false"' 1

run killed-right
expect 'no mistake' "$scratch/err" 'which died of signal 9 ' 1
expect 'no mistake' "$scratch/log" '^{"rule"' 0
[ "$failures" = 0 ]
