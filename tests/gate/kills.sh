# SPDX-License-Identifier: Apache-2.0
# kills.sh PROGRAM COUNT: runs are killed (kill -9) at random moments, the runner or one of its workers, and gone on with. No
# result that was written is lost, no line is torn, and in the end all is there.
set -u
gnomon=$1 count=$2
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1
unset GNOMON_TEST_FAULT
failures=0
fail() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$@"
}
lines() { grep -c '^{.*}$' "$1" 2>/dev/null; }
random() { od -An -N2 -tu2 /dev/urandom | tr -d ' '; }

cases=$("$gnomon" run 'query.flags.*' --list | wc -l)
kill=0
while [ "$kill" -lt "$count" ]; do
    rm -rf out
    before=0 attempts=0
    # As often killed as it takes; then let it end.
    while [ "$kill" -lt "$count" ] && [ "$attempts" -lt 8 ]; do
        resume=
        [ -f out/run.json ] && resume=--resume
        # shellcheck disable=SC2086 # one word or none
        "$gnomon" run 'query.flags.*' --jobs 2 --out out $resume >said 2>&1 </dev/null &
        runner=$!
        wait_ms=$(($(random) % 1500))
        sleep "$(printf '0.%03d' $((wait_ms % 1000)))"
        [ "$wait_ms" -lt 1000 ] || sleep 1
        kill=$((kill + 1)) attempts=$((attempts + 1))
        victim=$runner
        worker=$(cat "/proc/$runner/task/$runner/children" 2>/dev/null | cut -d ' ' -f 1)
        [ $((kill % 2)) = 0 ] || [ -z "$worker" ] || victim=$worker
        kill -9 "$victim" 2>/dev/null
        wait "$runner"
        [ -f out/results.jsonl ] || continue
        torn=$(grep -c -v '^{.*}$' out/results.jsonl)
        # Only the end may be torn off, by a kill in the middle of a write.
        [ "$torn" -le 1 ] || fail "$torn torn lines after kill $kill"
        now=$(grep -v '^{"name":"summary"' out/results.jsonl | grep -c '^{.*}$')
        [ "$now" -ge "$before" ] || fail "$before results before kill $kill, $now after it"
        before=$now
    done
    resume=
    [ -f out/run.json ] && resume=--resume
    # shellcheck disable=SC2086
    "$gnomon" run 'query.flags.*' --jobs 2 --out out $resume >said 2>&1 </dev/null
    status=$?
    # A killed worker is a crash of its case, which is a result.
    [ "$status" = 0 ] || [ "$status" = 1 ] || fail "status $status after the last kill: $(cat said)"
    [ "$(grep -v '^{"name":"summary"' out/results.jsonl | sort | uniq | wc -l)" = "$cases" ] ||
        fail "expected $cases results, found $(wc -l <out/results.jsonl) lines"
    [ "$(tail -n 1 out/results.jsonl | grep -c '^{"name":"summary"')" = 1 ] || fail 'no summary'
    wrong=$(grep -v '"status":"pass"\|"status":"crash"' out/results.jsonl | grep -v '^{"name":"summary"')
    [ -z "$wrong" ] || fail "a kill made something fail: $wrong"
    [ -s out/report.html ] || fail 'no report'
done
[ "$failures" = 0 ] || exit 1
echo "$kill kills, nothing lost"
