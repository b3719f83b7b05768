#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs the reference and uses it as somebody else would: through pkg-config, static and shared, and through CMake;
# from a place that the tree has been moved to. usage: consumer.sh BUILD CC [CFLAGS]
set -eu
build=$1 cc=$2 cflags=${3-}
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
expected='5 tiers are right; the verdict is exact'

check() {
    printed=$("$@") || { echo "$1: failed, printed: $printed"; exit 1; }
    [ "$printed" = "$expected" ] || { echo "$1: expected '$expected', found '$printed'"; exit 1; }
}

cmake --install "$build" --component reference --prefix "$work/first" > "$work/log" || { cat "$work/log"; exit 1; }
mv "$work/first" "$work/prefix"
if grep -rl "$work/first" "$work/prefix"; then
    echo "these files name the prefix that the tree was installed to"
    exit 1
fi
if ls "$work/prefix/include/gnomon/reference" | grep internal; then
    echo "an internal header is installed"
    exit 1
fi
libdir=$(dirname "$(find "$work/prefix" -name libgnomon_reference.a)")
export PKG_CONFIG_PATH="$libdir/pkgconfig"

# The words of pkg-config and the flags are lists.
$cc $cflags "$here/consumer/consumer.c" -o "$work/shared" $(pkg-config --cflags --libs gnomon-reference) -lm
LD_LIBRARY_PATH="$libdir" check "$work/shared"
ldd "$work/shared" > /dev/null
LD_LIBRARY_PATH="$libdir" ldd "$work/shared" | grep -q libgnomon_reference.so || { echo "not linked to the shared one"; exit 1; }

mkdir "$work/static-only"
cp "$libdir/libgnomon_reference.a" "$work/static-only"
$cc $cflags "$here/consumer/consumer.c" -o "$work/static" -L"$work/static-only" -Wl,-Bstatic \
    $(pkg-config --cflags gnomon-reference) -lgnomon_reference -Wl,-Bdynamic \
    $(pkg-config --static --libs-only-l gnomon-reference | sed 's/-lgnomon_reference//')
check "$work/static"

# Nothing but what the headers declare.
nm -D --defined-only "$libdir/libgnomon_reference.so" | awk '$3 ~ /^gn_ref/ { print $3 }' | sort > "$work/exported"
cat "$work/prefix/include/gnomon/reference/"*.h | grep -o 'gn_ref_[a-z0-9_]*(' | tr -d '(' | sort -u > "$work/declared"
if ! comm -23 "$work/exported" "$work/declared" | awk '{ print "exported, not declared: " $0; bad = 1 } END { exit bad }'; then
    exit 1
fi
grep -q gn_ref_tracer_closest_batch "$work/exported" || { echo "gn_ref_tracer_closest_batch is not exported"; exit 1; }

CFLAGS="$cflags" cmake -S "$here/consumer" -B "$work/cmake" -DCMAKE_C_COMPILER="$cc" -DCMAKE_PREFIX_PATH="$work/prefix" \
    > "$work/log" 2>&1 && cmake --build "$work/cmake" > "$work/log" 2>&1 || { cat "$work/log"; exit 1; }
check "$work/cmake/consumer-reference"
check "$work/cmake/consumer-reference-shared"
