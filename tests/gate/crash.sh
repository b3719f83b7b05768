# SPDX-License-Identifier: Apache-2.0
# crash.sh PROGRAM READER SHIM: a driver whose process ends where a structure is compacted, as the new one and as the old one.
set -u
here=$(cd "$(dirname "$0")" && pwd) || exit 1
gnomon=$1 reader=$2
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1
. "$here/shim.sh"
unset GNOMON_TEST_FAULT
shim "$3"
export GNOMON_SHIM_CRASH=compaction
failures=0
fail() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$@"
}
few=query.flags.cull_back.plain

# gate NAME STATUS NEW OLD ARGUMENT...
gate() {
    name=$1 wanted=$2 new=$3 old=$4
    shift 4
    "$gnomon" gate --driver "$new" --against "$old" --reruns 0 --time-budget 1000 --out gate "$@" >said 2>err </dev/null
    status=$?
    [ "$status" = "$wanted" ] || fail "$name: expected status $wanted, found $status: $(cat said err)"
    found=$("$reader" gate) || fail "$name: $found"
}

gate 'the new driver crashes while it is measured' 1 "$PWD/shim_icd.json" "$icd" $few
head -n 1 said | grep -q 'This may not land: .*fail.* newly' || fail "no word of the crash: $(cat said)"
grep -q '^- fails newly: `compaction' gate/gate.md || fail "gate.md: $(cat gate/gate.md)"
grep -q '"ruleId": "broken"' gate/gate.sarif || fail 'nothing in gate.sarif'
# What comes behind it is measured all the same.
grep -q '^  trace.* ratio\|^  trace.*([0-9.]* to [0-9.]*)' said || fail "nothing is measured behind the crash: $(cat said)"

# What the old driver fails at is no reason to stop.
gate 'failures of the old driver' 0 "$icd" "$PWD/shim_icd.json" --no-times --max-fails 1 --jobs 1 query.copy.compact.blas query.copy.compact.both $few
grep -q '^This may land: .*2 newly right' said || fail "failures of the old driver: $(cat said)"

gate 'neither answers' 0 "$PWD/shim_icd.json" "$PWD/shim_icd.json" --no-times query.copy.compact.blas $few
grep -q '^No change: 1 case answers bit for bit as before, 1 case is skipped or fails without an answer, as before\.$' said ||
    fail "neither answers: $(cat said)"
[ "$failures" = 0 ] || exit 1
echo "all as expected"
