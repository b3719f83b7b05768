# SPDX-License-Identifier: Apache-2.0
# The program driven as deqp-runner drives one of VK-GL-CTS: groups of cases from a list file, the lines of standard output read back, a
# crash blamed on the case that was open, the rest of the group started again. This imitates what deqp-runner's documentation says.
set -u
gnomon=$1
failures=0
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1
unset GNOMON_TEST_FAULT
fail() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$@"
}

# drive LIST RESULTS: every name of LIST gets a line `name,Status` in RESULTS.
drive() {
    cp "$1" left
    : >"$2"
    starts=0
    while [ -s left ]; do
        starts=$((starts + 1))
        [ "$starts" -le 10 ] || { fail 'started too often'; return; }
        "$gnomon" --deqp-log-filename="$scratch/log.qpa" --deqp-shadercache-filename="$scratch/shadercache.bin" \
            --deqp-caselist-file="$scratch/left" --deqp-surface-type=pbuffer >said 2>noise </dev/null
        code=$?
        awk -v results="$2" -v code="$code" '
            /^Test case \047.*\047\.\.$/ { open = $0; sub(/^Test case \047/, "", open); sub(/\047\.\.$/, "", open); next }
            open != "" && /^  [A-Za-z]+ \(.*\)$/ {
                status = $1
                if (status == "NotSupported") status = "Skip"
                if (status == "InternalError") status = "Fail"
                print open "," status >>results; open = ""
            }
            END { if (open != "") print open ",Crash" >>results }' said
        cut -d , -f 1 "$2" | sort >seen
        sort left | comm -23 - seen >rest
        cmp -s left rest && { fail "no progress: $(cat said noise)"; return; }
        sort left | cmp -s - rest && { fail "no progress: $(cat said noise)"; return; }
        mv rest left
    done
}

"$gnomon" run --list 'query.flags.cull_*' 'query.watertight.fan*' >cases.txt
drive cases.txt plain.csv
[ "$(sort plain.csv | cut -d , -f 1)" = "$(sort cases.txt)" ] || fail "a case has no result: $(cat plain.csv)"
# The same statuses as the suite's own runner gives.
"$gnomon" run 'query.flags.cull_*' 'query.watertight.fan*' --out own >out 2>&1
cut -d , -f 1,2 own/results.csv | sort >a
sort plain.csv >b
cmp a b || fail "the statuses differ: $(diff a b)"
grep -q '^#beginTestCaseResult query.flags.cull_back.plain' log.qpa || fail "the log lacks a case: $(head log.qpa)"
grep -q '^DONE!$' said || fail 'the session does not end with DONE!'

victim=query.flags.cull_back.plain
export GNOMON_TEST_FAULT=crash:$victim
drive cases.txt crash.csv
grep -q "^$victim,Crash$" crash.csv || fail "the crash: $(cat crash.csv)"
grep -v "^$victim," crash.csv | sort >a
grep -v "^$victim," plain.csv | sort >b
cmp a b || fail "a crash changes other results: $(diff a b)"
unset GNOMON_TEST_FAULT

"$gnomon" --deqp-case='query.flags.cull_back.*' >out 2>&1
[ "$(grep -c "^Test case '" out)" = "$(grep -c '^query.flags.cull_back' cases.txt)" ] || fail "a pattern: $(cat out)"
long=$(printf 'query.flags.cull_back.plain%600s' | tr ' ' '*')
"$gnomon" --deqp-case="$long" >out 2>&1 && grep -q '^DONE!$' out || fail "a long pattern: $(cat out)"
"$gnomon" --deqp-case="${long}x" >out 2>&1
[ $? = 4 ] || fail "a pattern that nothing matches: $(cat out)"
"$gnomon" --deqp-case=query.flags.cull_back.plain --deqp-base-seed=abc >out 2>&1
[ $? = 2 ] || fail "a seed that is no number: $(cat out)"
"$gnomon" --deqp-case=query.flags.cull_back.plain --deqp-log-filename=/dev/full >out 2>&1
[ $? = 3 ] || fail "a full disk under the log: $(cat out)"
"$gnomon" --deqp-case=query.flags.cull_back.plain >/dev/full 2>out
[ $? = 3 ] || fail "a full disk under the output: $(cat out)"
"$gnomon" --deqp-case=a --deqp-caselist-file=b >out 2>&1
[ $? = 2 ] || fail "two selectors: $(cat out)"
"$gnomon" --deqp-caselist-file=nowhere >out 2>&1
[ $? = 2 ] || fail "no such list: $(cat out)"

[ "$failures" = 0 ] || exit 1
echo "all as expected"
