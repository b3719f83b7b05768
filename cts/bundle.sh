#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes what runs on another machine: the program, the layer, and the libraries that both need, all found relative to each other.
# The C library stays the other machine's, since its drivers need it. `./gnomon bundle` calls this inside the environment.
set -u
usage='usage: gnomon bundle [--out PATH]     PATH ends in .tar.xz or .tar.gz, or is a folder that is not there yet'
source=$1 build=$2
shift 2
out=gnomon-bundle.tar.xz

die() {
    status=$1
    shift
    for line; do printf 'gnomon: %s\n' "$line" >&2; done
    exit "$status"
}

while [ $# -gt 0 ]; do
    case $1 in
    --out) [ $# -gt 1 ] || die 2 "--out needs a path" "$usage"; out=$2; shift ;;
    --out=*) out=${1#*=} ;;
    -h | --help) echo "$usage"; exit 0 ;;
    *) die 2 "bundle: expected --out, found $1" "$usage" ;;
    esac
    shift
done
case $out in
*.tar.xz) compress=J ;;
*.tar.gz | *.tgz) compress=z ;;
'') die 2 "--out: expected a path, found nothing" ;;
*) compress= ; [ ! -e "$out" ] || die 2 "$out is there already; name another folder" ;;
esac

work=$(mktemp -d) || exit 3
trap 'rm -rf "$work"' EXIT
name=gnomon
[ -n "$compress" ] || name=$(basename -- "$out")
tree=$work/$name
program=$build/cts/gnomon
layer=$build/layer/libVkLayer_gnomon_ray_tracing.so
mkdir -p "$tree/cts" "$tree/layer" "$tree/lib" "$tree/cxx" "$tree/expect" "$tree/licenses" || exit 3

cp "$program" "$tree/cts/" && cp "$layer" "$build/layer/VkLayer_gnomon_ray_tracing.json" "$tree/layer/" &&
    cp "$source"/cts/expect/*.txt "$tree/expect/" && cp "$source/LICENSE" "$tree/licenses/gnomon" || die 3 "cannot copy what was built"

# Every library either of them needs, but for the C library's. The C++ library is used only where the machine's own is older.
ldd "$program" "$layer" | sed -n 's/^[[:space:]]*\([^ ]*\) => \(\/[^ ]*\) .*/\1 \2/p' | sort -u >"$work/needed"
while read -r soname file; do
    case $soname in
    libc.so.* | libm.so.* | libpthread.so.* | libdl.so.* | librt.so.* | ld-linux*) continue ;;
    libstdc++.so.* | libgcc_s.so.*) folder=cxx ;;
    *) folder=lib ;;
    esac
    cp -L "$file" "$tree/$folder/$soname" || die 3 "cannot copy $file"
    package=$(dpkg-query -S "$(readlink -f "$file")" 2>/dev/null | sed -n '1s/:.*//p')
    [ -z "$package" ] || cp "/usr/share/doc/$package/copyright" "$tree/licenses/$package" 2>/dev/null
done <"$work/needed"
strip --strip-unneeded "$tree"/cts/gnomon "$tree"/layer/*.so "$tree"/lib/* "$tree"/cxx/* 2>/dev/null

# The newest versions of symbols that are asked of the machine.
newest() {
    objdump -T "$tree"/cts/gnomon "$tree"/layer/*.so "$tree"/lib/* $2 | grep -o "$1_[0-9][0-9.]*" | sort -Vu | tail -n 1
}
cxx=$(newest GLIBCXX '')
libc=$(newest GLIBC "$tree/cxx/*")

cat >"$tree/gnomon" <<EOF
#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Gnomon, in a bundle: runs the program with the libraries beside it on whatever Vulkan driver this machine has.
self=\$(readlink -f -- "\$0") && here=\${self%/*} || exit 3
# The driver may need a newer C++ library than ours, and ours one as new as $cxx: the newer one serves both.
own=
for file in \$(PATH=\$PATH:/usr/sbin:/sbin ldconfig -p 2>/dev/null | sed -n 's/^[[:space:]]*libstdc++\.so\.6 .*x86-64.* => //p'); do
    grep -q '$cxx\$\|$cxx[^0-9.]' "\$file" 2>/dev/null && own=\$file
done
[ -n "\$own" ] || export LD_LIBRARY_PATH="\$here/cxx\${LD_LIBRARY_PATH:+:\$LD_LIBRARY_PATH}"
export GNOMON_COMMAND="\$0" GNOMON_ANY_DRIVER=1
exec "\$here/cts/gnomon" "\$@"
EOF
chmod +x "$tree/gnomon"
cat >"$tree/README" <<EOF
Gnomon $("$program" --version | sed 's/.* //'), for x86-64 Linux with a C library of ${libc#GLIBC_} or newer and a Vulkan driver. Nothing has to be installed.

  ./gnomon run                     the conformance suite on the driver that Vulkan's loader finds first
  ./gnomon run --driver ICD.json   on another one
  ./gnomon gate ...                may a driver change land?
  ./gnomon layer -- APP            an application under the layer

Every command has --help. What is known of drivers is in expect/. Licenses of what is in here are in licenses/.
EOF

if [ -n "$compress" ]; then
    tar -C "$work" --sort=name --owner=0 --group=0 --numeric-owner --mtime=@0 -c"${compress}f" "$work/archive" "$name" &&
        mv "$work/archive" "$out" || die 3 "cannot write $out"
else
    mkdir -p "$(dirname -- "$out")" && mv "$tree" "$out" || die 3 "cannot write $out"
fi
printf 'bundle: %s, %s, for C libraries from %s\n' "$out" "$(du -sh "$out" | cut -f 1)" "${libc#GLIBC_}"
