# SPDX-License-Identifier: Apache-2.0
# The real gate on lavapipe: one driver against itself, planted failures, order dependence, rewritten expectations.
set -u
gnomon=$1 reader=$2
failures=0
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1
unset GNOMON_TEST_FAULT
icd=${GNOMON_LAVAPIPE_ICD:-${VK_DRIVER_FILES:-/usr/share/vulkan/icd.d/lvp_icd.json}}
# The same driver under another name, to be told apart.
sed "s|\"library_path\"[[:space:]]*:[[:space:]]*\"\([^/\"]*\)\"|\"library_path\": \"\1\"|" "$icd" >"$scratch/copied_icd.json"

fail() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$@"
}

# expect NAME STATUS PATTERN ARGUMENT...: of the gate, whose standard output has a line that matches.
expect() {
    name=$1 status=$2 pattern=$3
    shift 3
    "$gnomon" gate --driver "$icd" --jobs 1 "$@" >"$scratch/out" 2>"$scratch/err" </dev/null
    found=$?
    [ "$found" = "$status" ] || fail "$name: expected status $status, found $found: $(cat "$scratch/out" "$scratch/err")"
    grep -q -e "$pattern" "$scratch/out" || fail "$name: expected '$pattern', found: $(cat "$scratch/out" "$scratch/err")"
}
file_has() {
    grep -q -e "$2" "$1" || fail "$1: expected '$2', found: $(head -c 3000 "$1")"
}

few=query.flags.cull_back.plain

expect 'a driver against itself' 0 '^No change: all 2 cases' --against "$scratch/copied_icd.json" --no-times "$few" query.flags.cull_front.plain --out same
file_has same/gate.json '"exit_status": 0'
file_has same/gate.html 'No change'
! ls same | grep -q answers || fail 'the digests are left behind'

# The folder is the user's: nothing in it goes that the gate has not made, least of all when there is no driver.
mkdir -p same/answers same/answers-by-gnomon-killed
touch same/answers/thesis.txt same/answers-by-gnomon-killed/case.kept
"$gnomon" gate --driver nonexistent --out same >out 2>err </dev/null
[ $? = 2 ] && [ -e same/answers/thesis.txt ] || fail "a driver that there is not: $(cat err; ls -R same)"
# Another gate has the folder, while it runs the old driver.
mkfifo held
flock same cat held &
held=$!
exec 3>held
"$gnomon" gate --driver "$icd" --against "$scratch/copied_icd.json" --no-times "$few" --out same >out 2>err </dev/null
[ $? = 2 ] && grep -q 'same is in use' err && [ -e same/answers-by-gnomon-killed/case.kept ] || fail "a folder in use: $(cat out err)"
exec 3>&-
wait "$held"
# Answers are only kept to save time: where they cannot be, a case runs all the same.
GNOMON_ANSWERS_KEPT="$scratch/nowhere" "$gnomon" run --driver "$icd" "$few" --out kept >out 2>err </dev/null || fail "answers that cannot be kept: $(cat out err)"
# A gate that has been killed while it ran the new driver.
rm -r same/old
"$gnomon" gate --driver "$icd" --against "$scratch/copied_icd.json" --no-times "$few" query.flags.cull_front.plain --out same --resume >out 2>err </dev/null
[ $? = 0 ] && grep -q '^No change' out || fail "resumed before the old driver's turn: $(cat out err)"
[ -e same/answers/thesis.txt ] && [ ! -e same/answers-by-gnomon-killed ] || fail "files of others, and a killed gate's: $(ls -R same)"

# On some drivers answers to these vary from one run to the next, which is no change.
"$gnomon" gate --driver "$icd" --against "$scratch/copied_icd.json" --no-times --scale 0.02 --out vary \
    query.indices.first_vertex_stride query.indices.all_offsets 'query.watertight.*' >out 2>err </dev/null
[ $? = 0 ] && grep -q '^No change' out || fail "answers that vary: $(cat out err)"

GNOMON_TEST_FAULT=crash:$few expect 'a crash' 1 'This may not land: 1 case fails unexpectedly' "$few" query.flags.cull_front.plain --out crash
grep -q 'run again: passed 0 of 3 alone$' out || fail "a crash is rerun: $(cat out)"
file_has crash/gate.md "| .$few. |  | crash |"
file_has crash/gate.sarif '"ruleId": "unexpected"'

GNOMON_TEST_FAULT="crash:query.flags.cull_front.plain<$few" expect 'order dependence' 1 "it fails behind $few" \
    --reruns 2 query.flags.cull_back.disabled "$few" query.flags.cull_front.plain --out order
grep -q 'passed 2 of 2 alone, 0 of 2 behind' out || fail "order dependence: $(cat out)"

GNOMON_TEST_FAULT=crash:$few expect 'an update of what is not there' 1 '1 added, 0 changed, 0 removed' --expect x-fails.txt --update --reruns 0 "$few" --out update
file_has x-fails.txt '^# device: '
file_has x-fails.txt "^$few,Crash$"
GNOMON_TEST_FAULT=crash:$few expect 'what is expected' 0 'This may land' --expect x-fails.txt --reruns 0 "$few" --out expected
expect 'what is mended' 1 "x-fails.txt:[0-9]* expects Crash" --expect x-fails.txt --reruns 0 "$few" --out mended
expect 'an update of it' 1 '0 added, 0 changed, 1 removed' --expect x-fails.txt --update --reruns 0 "$few" --out mended
expect 'nothing is left' 0 'This may land' --expect x-fails.txt "$few" --out mended
printf '# device: 0x0001:0x0002 other\n' >y-fails.txt
"$gnomon" gate --driver "$icd" --expect y-fails.txt "$few" --out other >out 2>err </dev/null
[ $? = 2 ] && grep -q "of the device '0x0001:0x0002 other'" err || fail "a baseline of another device: $(cat out err)"
printf '%s\n' "$few" >z-skips.txt
expect 'a skip' 4 'No answer: every case was skipped' --expect z-skips.txt "$few" --out skipped
printf '%s\n' "$few" >z-flakes.txt
GNOMON_TEST_FAULT=crash:$few expect 'a flake' 0 'This may land' --expect z-flakes.txt "$few" query.flags.cull_front.plain --out flake
file_has flake/new/results.csv "^$few,KnownFlake,"

# Failures of several kinds, an expectation that fails as it should, one that is stale.
printf '%s\n' "query.flags.cull_front.plain,Fail" "query.flags.cull_back.disabled,Crash" >w-fails.txt
GNOMON_TEST_FAULT=crash:$few,crash:query.flags.cull_back.disabled,lost:query.flags.cull_opaque.plain expect 'a mixture' 1 'This may not land' --expect w-fails.txt \
    --reruns 0 'query.flags.cull_*.plain' query.flags.cull_back.disabled query.watertight.torus --out mixture
for folder in same crash order mended mixture skipped; do
    said=$("$reader" "$folder" 2>&1) || fail "reports of '$folder': $said"
done

[ "$failures" = 0 ] || exit 1
echo "all as expected"
