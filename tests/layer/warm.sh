#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# warm.sh PROGRAM: a driver's cache of instrumented shaders stays warm: a second run of the program adds nothing to it.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
export MESA_SHADER_CACHE_DIR="$folder" MESA_DISK_CACHE_MULTI_FILE=1
unset MESA_SHADER_CACHE_DISABLE
list() { find "$folder" -type f ! -name '*.tmp' ! -name index ! -name marker | sort; }
"$1" >/dev/null
list >"$folder.first"
"$1" >/dev/null
list >"$folder.second"
entries=$(wc -l <"$folder.first")
added=$(comm -13 "$folder.first" "$folder.second" | wc -l)
rm -f "$folder.first" "$folder.second"
echo "$entries entries after the first run, $added added by the second"
[ "$entries" -gt 10 ] && [ "$added" -eq 0 ]
