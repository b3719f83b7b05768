# SPDX-License-Identifier: Apache-2.0
# same.sh PROGRAM COUNT [busy]: so many gates of a driver against itself all have to say "No change"; with "busy" something else
# computes on one core all the while. By hand: half a minute each.
set -u
gnomon=$1 count=$2
scratch=$(mktemp -d) || exit 1
loop=
trap '[ -z "$loop" ] || kill "$loop"; rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1
icd=${GNOMON_LAVAPIPE_ICD:-${VK_DRIVER_FILES:-/usr/share/vulkan/icd.d/lvp_icd.json}}
if [ "${3-}" = busy ]; then
    (while :; do :; done) &
    loop=$!
fi
good=0
for round in $(seq "$count"); do
    "$gnomon" gate --driver "$icd" --against "$icd" 'query.flags.cull_*' 'pipeline.flags.cull_*' --out gate >said 2>/dev/null
    status=$?
    if [ "$status" = 0 ] && grep -q '^No change' said; then
        good=$((good + 1))
    else
        echo "FAILED: round $round, exit status $status:"
        cat said
    fi
done
echo "$good of $count say \"No change\""
[ "$good" = "$count" ]
