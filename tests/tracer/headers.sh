#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Every public header compiles alone, as C17 and as C++17, without a warning. usage: headers.sh ROOT CC CXX
set -eu
root=$1 cc=$2 cxx=$3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
count=0
for header in "$root"/reference/*.h; do
    case $header in
    *_internal.h) continue ;;
    esac
    grep -q "$(basename "$header")" "$root/reference/install.cmake" || continue
    echo "#include \"reference/$(basename "$header")\"" > "$work/alone.c"
    cp "$work/alone.c" "$work/alone.cc"
    "$cc" -std=c17 -Wall -Wextra -Wpedantic -Werror -I"$root" -fsyntax-only "$work/alone.c"
    "$cxx" -std=c++17 -Wall -Wextra -Wpedantic -Werror -I"$root" -fsyntax-only "$work/alone.cc"
    count=$((count + 1))
done
[ "$count" -ge 4 ] || { echo "$count public headers, expected at least 4"; exit 1; }
