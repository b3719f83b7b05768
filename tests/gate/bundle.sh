# SPDX-License-Identifier: Apache-2.0
# A bundle, made, moved elsewhere, and run with nothing in its environment: only the C library is the machine's.
set -u
source=$1 build=$2
scratch=$(mktemp -d) || exit 1
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1
icd=${GNOMON_LAVAPIPE_ICD:-${VK_DRIVER_FILES:-/usr/share/vulkan/icd.d/lvp_icd.json}}
failures=0
fail() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$@"
}

sh "$source/cts/bundle.sh" "$source" "$build" --out "$scratch/made" >out 2>&1 || { cat out; exit 1; }
grep -q 'for C libraries from 2\.3[0-8]$' out || fail "it needs a C library newer than 2.38: $(cat out)"
mkdir -p 'moved to/a place' && mv made 'moved to/a place/gnomon'
here="$scratch/moved to/a place/gnomon"
env -i LD_LIBRARY_PATH="$here/cxx" ldd "$here/cts/gnomon" "$here"/layer/*.so >needs 2>&1
! grep 'not found' needs || fail "libraries are missing: $(cat needs)"
foreign=$(grep ' => /' needs | grep -v -F " => $here/" | grep -v '/lib\(c\|m\)\.so\.')
[ -z "$foreign" ] || fail "libraries are not the bundle's own: $foreign"
env -i VK_DRIVER_FILES="$icd" HOME=/nonexistent "$here/gnomon" run query.flags.cull_back.plain --out "$scratch/out-run" >out 2>&1 ||
    fail "it does not run: $(cat out)"
grep -q '^The case passed' out || fail "expected a pass, found: $(cat out)"
env -i VK_DRIVER_FILES="$icd" HOME=/nonexistent "$here/gnomon" layer -- "$here/cts/gnomon" run query.flags.cull_back.plain --out "$scratch/out-layer" >out 2>&1 ||
    fail "the layer does not run: $(cat out)"
grep -q '^gnomon layer: PASS' out || fail "expected the layer's statement, found: $(cat out)"
env -i "$here/gnomon" rules >out 2>&1 || fail "rules: $(cat out)"
sh "$source/cts/bundle.sh" "$source" "$build" --out "$scratch" >out 2>&1
[ $? = 2 ] || fail "a folder that is there: $(cat out)"

[ "$failures" = 0 ] || exit 1
echo "all as expected"
