#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Indirect and host builds run on a driver that has them, are skipped with the reason on one that has not, and notice
# each of the layer's faults.
# usage: builds.sh GNOMON LAYER_FOLDER
set -eu
gnomon=$1
folder=$2
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
failed=0

# hosted FAULT CASE...: with the layer, which has that fault; none has no name.
hosted() {
    fault=$1
    shift
    env GNOMON_HOSTED_FAULT="$fault" VK_ADD_LAYER_PATH="$folder" VK_INSTANCE_LAYERS=VK_LAYER_GNOMON_hosted \
        "$gnomon" run --out "$out/run" --scale 0.05 --jobs 1 "$@"
}
# want NAME EXIT PATTERN COMMAND...: the command ends so and prints a line that matches.
want() {
    name=$1 status=$2 pattern=$3
    shift 3
    got=0
    "$@" > "$out/text" 2>&1 || got=$?
    if [ "$got" != "$status" ] || ! grep -q -- "$pattern" "$out/text"; then
        failed=$((failed + 1))
        echo "FAILED $name: expected exit $status and '$pattern', got exit $got and"
        cat "$out/text"
    fi
}

# Every case but those of firstVertex, which lavapipe 25.0 applies twice however it builds.
cases=$("$gnomon" run --list '*.builds.*' | grep -v first_vertex)
# shellcheck disable=SC2086 # names have no spaces
want 'all of them with the layer' 0 "^All $(echo "$cases" | wc -l) cases passed" hosted '' $cases
skipped() {
    "$gnomon" run --out "$out/skipped" --jobs 1 "$1" > /dev/null 2>&1 && return 1
    grep "$2" "$out/skipped/results.jsonl"
}
want 'host commands without it' 0 'lacks the feature' skipped query.builds.host.meshes accelerationStructureHostCommands
want 'indirect builds without it' 0 'lacks the feature' skipped query.builds.indirect.meshes accelerationStructureIndirectBuild
for fault in 'lost host.meshes' 'lost mixed.top_on_host' 'unjoined deferred.meshes' 'range indirect.offsets'; do
    want "$fault" 1 'failed' hosted "${fault% *}" "query.builds.${fault#* }"
done
[ "$failed" = 0 ] && echo "passed"
