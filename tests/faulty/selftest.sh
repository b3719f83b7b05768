#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The self-test at work: faults of every kind of place are caught, one that no chosen case can see is missed and said so.
# usage: selftest.sh GNOMON
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
selftest() { "$gnomon" run --selftest --out "$out/run" --jobs 1 "$@"; }

# One fault each of instances, geometries, updates, copies, queries, limits of the range and reading back.
for fault in mask.bit_3 primitives.65536 geometry_flags.update clone.first serialize.size range.tmin_below hit.facing; do
    want "$fault" 0 '^1 passed, 0 failed$' selftest --faults "$fault" 'query.masks.single*' 'query.planted.*' 'query.exact.*'
done
want 'a fault out of sight' 1 '^MISSED *mask.bit_3' selftest --faults mask.bit_3 'query.exact.*'
want 'and the end says so' 1 '^0 passed, 1 failed$' selftest --faults mask.bit_3 'query.exact.*'
want 'no such fault' 2 "no fault matches 'nonsense'" selftest --faults nonsense 'query.exact.*'
want 'faults without the self-test' 2 'goes with --selftest' "$gnomon" run --faults mask.bit_3
want 'an unknown fault opens no driver' 4 'nothing ran' env GNOMON_FAULT=nonsense VK_INSTANCE_LAYERS=VK_LAYER_GNOMON_faulty \
    VK_ADD_LAYER_PATH="$2" "$gnomon" run query.exact.tmin --out "$out/unknown"
echo "$passed passed, $failed failed"
[ "$failed" = 0 ]
