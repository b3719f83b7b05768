# SPDX-License-Identifier: Apache-2.0
# faults.sh PROGRAM FAULTY_FOLDER SHIM FAULTS CASES: of each fault of tests/faulty (names, or "all"), `gate` against the same driver
# without it reports as newly wrong exactly the cases that `run` shows to be worse with it. CASES are filters, or "sample": a
# case of every family, and what other cases could not see.
set -u
here=$(cd "$(dirname "$0")" && pwd) || exit 1
gnomon=$1 faulty=$2 library=$3 faults=$4 filters=$5
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1
. "$here/shim.sh"
unset GNOMON_TEST_FAULT GNOMON_FAULT
shim "$library"
failures=0 total=0 worse=0
fail() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$@"
}
if [ "$faults" = all ]; then
    faults=$(grep -oE '"[a-z0-9_]+\.[a-z0-9_.]+"' "$here/../faulty/faults.c" | tr -d '"' | grep -v '^query\.\|^pipeline\.')
fi
if [ "$filters" = sample ]; then
    filters=$("$gnomon" run --list | awk -F . '!n[$1 "." $2]++ || $2 == "planted"')
fi
export VK_INSTANCE_LAYERS=VK_LAYER_GNOMON_faulty VK_ADD_LAYER_PATH="$faulty"

# statuses FILE: `name rank` of every case, from best to worst as the gate has it.
statuses() {
    sed -n 's/^{"name":"\([^"]*\)","status":"\([^"]*\)".*/\1 \2/p' "$1/results.jsonl" | awk '
        BEGIN { split("pass skip leak fail error timeout crash", words); for (i in words) rank[words[i]] = i }
        $1 != "summary" { print $1, rank[$2] }' | sort
}
# shellcheck disable=SC2086 # lists of words
{
    "$gnomon" run $filters --driver "$icd" --scale 0.02 --out none >said 2>&1
    statuses none >none.txt
    [ -s none.txt ] || { cat said; exit 1; }
    for fault in $faults; do
        total=$((total + 1))
        GNOMON_FAULT=$fault "$gnomon" run $filters --driver "$icd" --scale 0.02 --out with >said 2>&1
        statuses with | join none.txt - | awk '$3 > $2 { print $1 }' >expected
        GNOMON_SHIM_FAULT=$fault "$gnomon" gate $filters --driver "$PWD/shim_icd.json" --against "$icd" --scale 0.02 --no-times \
            --reruns 0 --out gate >said 2>&1
        status=$?
        awk -F '"' '$2 == "name" { name = $4 } $2 == "change" && $4 == "newly wrong" { print name }' gate/gate.json | sort >found
        cmp -s expected found || fail "$fault: expected and found as newly wrong: $(diff expected found | head -n 20)"
        wanted=0
        [ -s expected ] && wanted=1 && worse=$((worse + 1))
        [ "$status" = "$wanted" ] || fail "$fault: exit status $status, expected $wanted: $(tail -n 5 said)"
        echo "$fault: $(wc -l <expected) newly wrong"
        rm -rf with gate
    done
}
[ "$worse" -gt 0 ] || fail 'no fault made anything worse'
echo "$total faults, $worse of them make cases worse, $failures failures"
[ "$failures" = 0 ]
