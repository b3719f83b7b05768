# SPDX-License-Identifier: Apache-2.0
# Which variables of the host are seen inside the private root.
. "${0%/*}/common.sh"

dry_run() {
    env GNOMON_DRY_RUN=1 GNOMON_ENVIRONMENT=private "$@" "$gnomon" run >"$scratch/out" 2>"$scratch/err" </dev/null ||
        fail "$*: expected status 0, found $?: $(cat "$scratch/err")"
}
is_unset() { tr '\n' '|' <"$scratch/out" | grep -q -e "|--unsetenv|$1|"; }

dry_run LD_LIBRARY_PATH=/x LD_PRELOAD= PYTHONPATH=/x CC=x CFLAGS=x CMAKE_PREFIX_PATH=/x PKG_CONFIG_PATH=/x XDG_DATA_DIRS=/x \
    VK_LOADER_DEBUG=x GNOMON_X=x CI=true TERM=x LP_NUM_THREADS=1 MY_APPLICATION=x
for name in LD_LIBRARY_PATH LD_PRELOAD PYTHONPATH CC CFLAGS CMAKE_PREFIX_PATH PKG_CONFIG_PATH XDG_DATA_DIRS; do
    is_unset "$name" || fail "$name: expected to be unset inside"
done
for name in VK_LOADER_DEBUG GNOMON_X CI TERM HOME LP_NUM_THREADS MY_APPLICATION; do
    ! is_unset "$name" || fail "$name: expected to be kept inside"
done

# The host's own programs come last, those of its system folders not at all.
mkdir "$scratch/bin"
dry_run "PATH=/usr/local/bin:$scratch/bin:/usr/bin:/bin"
path=$(sed -n '/^PATH$/{n;p;q;}' "$scratch/out")
[ "$path" = "/usr/bin:/bin:/usr/sbin:/sbin:$scratch/bin" ] || fail "PATH: found $path"
finish
