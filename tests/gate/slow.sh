# SPDX-License-Identifier: Apache-2.0
# slow.sh PROGRAM SHIM: a driver whose operations really take 1.5 times as long is caught, one whose operations take 1.1 times as
# long is not. By hand, where little else runs.
set -u
here=$(cd "$(dirname "$0")" && pwd) || exit 1
gnomon=$1
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1
. "$here/shim.sh"
shim "$2"
failures=0
for row in '1.5 1' '1.1 0'; do
    GNOMON_SHIM_SLOW=${row% *} "$gnomon" gate --driver "$PWD/shim_icd.json" --against "$icd" query.flags.cull_back.plain --out gate >said 2>/dev/null
    status=$?
    cat said
    [ "$status" = "${row#* }" ] || { failures=$((failures + 1)); echo "FAILED: ${row% *} times as slow: exit status $status"; }
done
[ "$failures" = 0 ]
