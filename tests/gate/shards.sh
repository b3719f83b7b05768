# SPDX-License-Identifier: Apache-2.0
# Shards of a run on lavapipe, joined: the same as the run in one piece; what does not fit is refused.
set -u
gnomon=$1
failures=0
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1
unset GNOMON_TEST_FAULT
few='query.flags.cull_*'
fail() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$@"
}
# expect NAME STATUS PATTERN COMMAND...: and what it says, on either stream, has a line that matches.
expect() {
    name=$1 status=$2 pattern=$3
    shift 3
    "$gnomon" "$@" >out 2>&1 </dev/null
    found=$?
    [ "$found" = "$status" ] || fail "$name: expected status $status, found $found: $(cat out)"
    grep -q -e "$pattern" out || fail "$name: expected '$pattern', found: $(cat out)"
}
statuses() { grep -v '^{"name":"summary"' "$1/results.jsonl" | sed 's/.*"name":"\([^"]*\)","status":"\([^"]*\)".*/\1 \2/' | sort; }

export GNOMON_TEST_FAULT=crash:query.flags.cull_back.plain
expect 'in one piece' 1 '^1 of ' run "$few" --out whole
for shard in 1 2 3; do
    "$gnomon" run "$few" --shard $shard/3 --durations whole/results.jsonl --out part$shard >out 2>&1
done
unset GNOMON_TEST_FAULT
expect 'joined' 1 '^1 of .* crashed' merge part1 part2 part3 --out joined
statuses whole >a
statuses joined >b
cmp a b || fail 'joined shards differ from the whole'
[ -s joined/replay/query.flags.cull_back.plain.json ] && [ -s joined/report.html ] && [ -s joined/junit.xml ] && [ -s joined/results.csv ] ||
    fail "reports are missing: $(ls joined joined/replay)"
printf 'query.flags.cull_back.plain,Crash\n' >known.txt
expect 'joined, with expectations' 0 'failed as expected' merge part3 part1 part2 --expect known.txt --out joined2

printf '# device: 0x1234:0x5678 other\nquery.flags.cull_back.plain,Crash\n' >elsewhere.txt
expect 'expectations of another device' 2 'are of the device .0x1234:0x5678 other' merge part1 part2 part3 --expect elsewhere.txt --out x

# One case for two shards: the one that is left without makes a folder all the same.
for shard in 1 2; do
    "$gnomon" run query.flags.cull_back.plain --shard $shard/2 --out only$shard >out 2>&1
    echo $? >>statuses
done
[ "$(sort statuses | tr '\n' ' ')" = '0 4 ' ] || fail "shards of one case: $(cat statuses)"
expect 'joined, one without cases' 0 'The case passed' merge only1 only2 --out joined3
expect 'joined in the other order' 0 'The case passed' merge only2 only1 --out joined4
expect 'another choice of cases' 2 'another choice of cases' merge only1 part2 part3 --out x
"$gnomon" run "$few" --shard 1/2 --out half1 >out 2>&1
"$gnomon" run 'query.flags.cull_b*' --shard 2/2 --out half2 >out 2>&1
expect 'other filters' 2 'another choice of cases' merge half1 half2 --out x
expect 'going on with another shard' 2 'another shard' run "$few" --shard 2/2 --out half1 --resume

expect 'a shard is missing' 2 'shard 2 of 3 is missing' merge part1 part3 --out x
expect 'a shard twice' 2 'are both shard 1 of 3' merge part1 part1 part2 part3 --out x
expect 'no shard' 2 'is no folder of a run' merge part1 nowhere --out x
expect 'into a shard' 2 'is one of the folders' merge part1 part2 part3 --out part1
"$gnomon" run "$few" --shard 3/3 --durations whole/results.jsonl --seed 2 --out other >out 2>&1
expect 'another seed' 2 'another seed' merge part1 part2 other --out x
"$gnomon" run "$few" --shard 3/3 --out other >out 2>&1
expect 'another way to share out' 2 'another file of durations' merge part1 part2 other --out x
sed 's/"suite":"[^"]*"/"suite":"0123456789abcdef"/' part3/run.json >run.json && mv run.json part3/run.json
expect 'another suite' 2 'another suite' merge part1 part2 part3 --out x
sed -i '1d' part2/results.jsonl
expect 'a shard that stopped' 2 'run it to its end' merge part1 part2 part3 --out x
expect 'twice the same cases' 2 'is in more than one of the folders' merge whole whole --out x

[ "$failures" = 0 ] || exit 1
echo "all as expected"
