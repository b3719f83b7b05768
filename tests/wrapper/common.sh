# SPDX-License-Identifier: Apache-2.0
# Read by the tests of the wrapper: a scratch folder, and expectations that print both values and go on.
set -u
source=$1
gnomon=$source/gnomon
failures=0
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
export GNOMON_CACHE="$scratch/cache"
unset GNOMON_BUILD GNOMON_ENVIRONMENT GNOMON_DRY_RUN VK_DRIVER_FILES VK_ICD_FILENAMES VK_ADD_DRIVER_FILES VK_LAYER_PATH VK_ADD_LAYER_PATH

fail() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$@"
}

# expect_status NAME STATUS COMMAND...: and leaves what it printed in $scratch/out and $scratch/err.
expect_status() {
    name=$1 expected=$2
    shift 2
    "$@" >"$scratch/out" 2>"$scratch/err" </dev/null
    found=$?
    [ "$found" = "$expected" ] || fail "$name: expected status $expected, found $found: $(cat "$scratch/err")"
}

# expect_text NAME FILE PATTERN: a line of FILE matches.
expect_text() {
    grep -q -e "$3" "$2" || fail "$1: expected a line that matches '$3', found: $(cat "$2")"
}

finish() {
    [ "$failures" = 0 ] || exit 1
    echo "all as expected"
}
