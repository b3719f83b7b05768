#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Usage: command.sh GNOMON MODULES SPIRV_VAL FOLDER: runs `gnomon instrument` and compares exit statuses and outputs.
gnomon=$1 modules=$2 validator=$3 folder=$4
failures=0
mkdir -p "$folder" || exit 3

# expect STATUS TEXT ARGUMENTS...: the exit status, and a text in what is printed.
expect() {
  status=$1 text=$2
  shift 2
  "$gnomon" instrument "$@" >"$folder/out" 2>&1
  found=$?
  if [ "$found" != "$status" ] || ! grep -qF -- "$text" "$folder/out"; then
    echo "gnomon instrument $*: expected status $status and \"$text\", found status $found and:"
    cat "$folder/out"
    failures=$((failures + 1))
  fi
}

expect 0 'untouched: every operation is proved right' "$modules/closest_good.comp.spv" -o "$folder/good.spv"
cmp "$modules/closest_good.comp.spv" "$folder/good.spv" || failures=$((failures + 1))
expect 1 'proceed_after_loop.comp:15: error: OpRayQueryProceedKHR on q' "$modules/proceed_after_loop.comp.spv" -o "$folder/bad.spv"
"$validator" --target-env vulkan1.2 "$folder/bad.spv" || failures=$((failures + 1))
expect 1 '"rule": "query.proceed.after_false"' "$modules/proceed_after_loop.comp.spv" --static-only --json
expect 0 'records go to set 3, binding 5' "$modules/run_generate.comp.spv" -o "$folder/run.spv" --set 3 --binding 5
expect 0 'declined: the module itself uses set 0, binding 1' "$modules/run_generate.comp.spv" -o "$folder/same.spv" --set 0 --binding 1
cmp "$modules/run_generate.comp.spv" "$folder/same.spv" || failures=$((failures + 1))
expect 1 'query.committed.too_early' "$modules/committed_no_proceed.comp.spv" --static-only --profile wgpu
expect 1 'trace.recursion' "$modules/trace_nested.rchit.spv" --static-only --max-recursion 1
expect 0 'query.proceed.limit' "$modules/closest_good.comp.spv" --static-only --json --proceed-limit 5
# The same words from another place and environment.
expect 1 'instrumented' "$modules/proceed_after_loop.comp.spv" -o "$folder/here.spv"
(cd / && env -i HOME=/nowhere LC_ALL=tr_TR.UTF-8 TZ=Asia/Tokyo "$gnomon" instrument "$modules/proceed_after_loop.comp.spv" -o "$folder/there.spv" >/dev/null)
cmp "$folder/here.spv" "$folder/there.spv" || failures=$((failures + 1))
expect 2 'expected -o OUT.spv' "$modules/closest_good.comp.spv"
expect 2 'expected a SPIR-V module' -o "$folder/none.spv"
expect 2 "there is no profile 'metal'" "$modules/closest_good.comp.spv" --static-only --profile metal
expect 2 "expected a number" "$modules/closest_good.comp.spv" --static-only --set -1
expect 2 'No such file' "$folder/missing.spv" --static-only
printf 'not a module' >"$folder/text.spv"
expect 2 'a module has 5 to' "$folder/text.spv" -o "$folder/text.out.spv"
cmp "$folder/text.spv" "$folder/text.out.spv" || failures=$((failures + 1))
printf 'odd' >"$folder/odd.spv"
expect 2 'expected words of 4 bytes, found 3 bytes' "$folder/odd.spv" --static-only
exit $((failures > 0))
