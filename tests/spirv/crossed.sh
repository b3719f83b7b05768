#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# crossed.sh MODULES OUT: takes every module of a folder to GLSL and back (SPIRV-Cross, glslang), which no longer looks like what glslang
# makes of the original: other names, other loops, temporaries, one precision. `test_spirv_passes OUT` judges and runs what comes out.
set -eu
[ $# -eq 2 ] || { echo "usage: $0 MODULES OUT" >&2; exit 2; }
mkdir -p "$2"
made=0 refused=0
for module in "$1"/*.spv; do
    name=$(basename "$module" .spv)
    case $name in
    *.spvasm) stage=${name%.spvasm} stage=${stage##*.}; [ "$stage" = rgen ] || stage=comp ;;
    *) stage=${name##*.} ;;
    esac
    if spirv-cross --version 460 --vulkan-semantics "$module" --output "$2/$name.glsl" >/dev/null 2>&1 &&
        glslangValidator --target-env vulkan1.3 -g0 --quiet -S "$stage" -V -o "$2/$name.spv" "$2/$name.glsl" >/dev/null 2>&1; then
        made=$((made + 1))
    else
        echo "$name: SPIRV-Cross and glslang do not take it" >&2
        refused=$((refused + 1))
    fi
done
echo "$made modules in $2, $refused refused"
