# SPDX-License-Identifier: Apache-2.0
# `gnomon layer`: the application runs as it would, the verdict and the exit status are right, and the files are there.
set -u
gnomon=$1 application=$2 failures=0
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
export TMPDIR="$scratch/tmp"
mkdir "$TMPDIR"
unset VK_ADD_LAYER_PATH VK_INSTANCE_LAYERS
ulimit -c 0

fail() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$@"
}
expect() {
    name=$1 expected=$2
    shift 2
    "$gnomon" layer "$@" >"$scratch/out" 2>"$scratch/err" </dev/null
    found=$?
    [ "$found" = "$expected" ] || fail "$name: expected status $expected, found $found: $(cat "$scratch/err")"
    [ -z "$(ls -A "$TMPDIR")" ] || fail "$name: left $(ls "$TMPDIR")"
}
expect_text() {
    grep -q -e "$3" "$2" || fail "$1: expected a line that matches '$3', found: $(cat "$2")"
}

expect 'valid usage' 0 -- "$application" right
expect_text 'valid usage' "$scratch/err" '^gnomon layer: PASS: 0 errors, 0 warnings and 0 notes in '
expect_text 'valid usage' "$scratch/err" '^  checked     1 TLAS builds judged'
expect 'the dashes may be left out' 0 "$application" right

expect 'misuse' 1 --log "$scratch/log" --sarif "$scratch/sarif" -- "$application" wrong
expect_text 'misuse' "$scratch/err" '^gnomon: error: build\.order\.blas_never_built: '
expect_text 'misuse' "$scratch/err" '^gnomon layer: FAIL: 1 error, 0 warnings and 0 notes in '
expect_text 'misuse' "$scratch/err" '^  error       build\.order\.blas_never_built: 1 time at 1 site$'
expect_text 'the log' "$scratch/log" '^{"rule":"build\.order\.blas_never_built","severity":"error"'
expect_text 'the log' "$scratch/log" '^{"statement":{"profile":"vulkan","ending":"the instance was destroyed"'
expect_text 'SARIF' "$scratch/sarif" '"ruleId": "build\.order\.blas_never_built"'

expect 'several processes' 1 --log "$scratch/log" --sarif "$scratch/sarif" -- \
    sh -c '"$1" wrong; "$1" right; "$1" wrong' sh "$application"
expect_text 'several processes' "$scratch/err" '^  error       build\.order\.blas_never_built: 2 times at 2 sites$'
expect_text 'several processes' "$scratch/err" '^  checked     3 TLAS builds judged'
[ "$(grep -c '"statement"' "$scratch/log")" = 3 ] || fail "expected 3 statements, found: $(cat "$scratch/log")"
[ "$(grep -c '"results"' "$scratch/sarif")" = 3 ] || fail "expected 3 runs, found: $(cat "$scratch/sarif")"

expect 'a profile' 0 --profile wgpu --log "$scratch/log" -- "$application" right
expect_text 'a profile' "$scratch/log" '"profile":"wgpu"'

expect 'no end of the instance' 1 --log "$scratch/log" -- "$application" leave
expect_text 'no end of the instance' "$scratch/log" '"ending":"the process ended without destroying the instance"'
expect 'a child' 1 --log "$scratch/log" -- "$application" fork
expect_text 'a child' "$scratch/err" '^gnomon layer: FAIL: 1 error, 0 warnings and 0 notes in '
! grep -q damaged "$scratch/err" || fail "a child: $(cat "$scratch/err")"
[ "$(grep -c '"statement"' "$scratch/log")" = 1 ] || fail "a child: expected 1 statement, found: $(cat "$scratch/log")"
expect 'a crash' 1 --log "$scratch/log" -- "$application" abort
expect_text 'a crash' "$scratch/err" ', which died of signal 6 '
expect_text 'a crash' "$scratch/log" '"ending":"the process died of SIGABRT"'
expect 'a failure of its own' 1 -- "$application" fail
expect_text 'a failure of its own' "$scratch/err" '^gnomon layer: FAIL: 0 errors.*, which ended with status 7$'
expect 'no ray tracing' 4 -- true
expect_text 'no ray tracing' "$scratch/err" '^gnomon layer: NOTHING JUDGED: '

expect 'no application' 2
expect 'an application that is not there' 2 -- "$scratch/nosuch"
expect 'an unknown profile' 2 --profile opengl -- true
expect 'a log that cannot be written' 2 --log "$scratch/no/log" -- true
expect 'a log without a name' 2 --log '' -- true
expect_text 'a log without a name' "$scratch/err" '--log: expected the name of a file'
expect 'a SARIF file that cannot be written' 2 --sarif "$scratch/no/sarif" -- true

expect 'the variables' 0 --print-env --profile hgi --log "$scratch/a'log"
expect_text 'the variables' "$scratch/out" "^export VK_INSTANCE_LAYERS='VK_LAYER_GNOMON_ray_tracing'$"
(
    eval "$(cat "$scratch/out")"
    "$application" wrong 2>/dev/null
)
expect_text 'evaluated' "$scratch/a'log" '"profile":"hgi"'

# A statement on demand, and a signal that is passed on.
mkfifo "$scratch/pipe"
VK_GNOMON_RAY_TRACING_STATEMENT_SIGNAL=USR1 "$gnomon" layer --log "$scratch/log" -- "$application" wait \
    >"$scratch/pipe" 2>"$scratch/err" </dev/null &
process=$!
read -r _ <"$scratch/pipe"
kill -USR1 "$process"
for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
    grep -q 'statement: asked for by a signal' "$scratch/err" && break
    sleep 0.1
done
expect_text 'on demand' "$scratch/err" '^gnomon: note: statement: asked for by a signal, the process goes on: 1 finding at 1 site'
kill -TERM "$process"
wait "$process"
[ $? = 1 ] || fail 'terminated: expected status 1'
expect_text 'terminated' "$scratch/err" ', which died of signal 15 '

[ "$failures" = 0 ] || exit 1
echo "all as expected"
