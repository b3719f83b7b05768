# SPDX-License-Identifier: Apache-2.0
# Paths on the command line mean inside the private root what they mean on the host: which binds the wrapper computes for them.
. "${0%/*}/common.sh"

# command_line ARGUMENT...: what the wrapper would run, one word a line, in $scratch/out.
command_line() {
    GNOMON_DRY_RUN=1 GNOMON_ENVIRONMENT=private "$gnomon" run "$@" >"$scratch/out" 2>"$scratch/err" </dev/null ||
        fail "$*: expected status 0, found $?: $(cat "$scratch/err")"
}
joined() { tr '\n' '|' <"$scratch/out"; }
expect_words() {
    case "|$(joined)" in *"|$2|"*) ;; *) fail "$1: expected $2 in $(joined)" ;; esac
}
expect_none() {
    case "|$(joined)" in *"$2"*) fail "$1: expected no $2 in $(joined)" ;; esac
}

# The root is not there yet; its name is the word after the first --ro-bind.
command_line
root=$(sed -n '/^--ro-bind$/{n;p;q;}' "$scratch/out")
case $root in "$GNOMON_CACHE"/trixie-*) ;; *) fail "expected a root in $GNOMON_CACHE, found '$root'" ;; esac
mkdir -p "$root/usr/bin" "$root/usr/share" "$root/usr/lib" "$root/etc" "$root/var/lib"
expect_words 'the root is read-only' "--ro-bind|$root|/"
expect_words 'no device of the host but those named' '--dev|/dev'
expect_words 'nothing is left behind' '--die-with-parent|--unshare-pid'
expect_words 'temporary files are the host'"'"'s' '--bind|/tmp|/tmp|--bind|/var/tmp|/var/tmp'
expect_none 'no system folder of the host' '|--bind|/usr|'
expect_none 'no system folder of the host' '|--bind|/etc|'

command_line /etc/debian_version
expect_words 'a file in a system folder' '--bind|/etc/debian_version|/etc/debian_version'
command_line --models=/etc/debian_version
expect_words 'the value of an option' '--bind|/etc/debian_version|/etc/debian_version'
cd "$scratch" || exit 1
command_line ../../../../../../../../etc/debian_version
expect_words 'a relative path' '--bind|/etc/debian_version|/etc/debian_version'
ln -s /etc/debian_version link
command_line link
expect_words 'a symbolic link out of a folder that is seen' '--bind|/etc/debian_version|/etc/debian_version'
mkdir 'with space'
command_line "$scratch/with space" --out=new 'a filter*'
expect_none 'a folder that is seen anyway' "|--bind|$scratch"
expect_words 'arguments stay as they are' "run|$scratch/with space|--out=new|a filter*"
expect_words 'the working folder stays' "--chdir|$scratch"

command_line /usr/share
expect_none "a folder that both have is the environment's" '|--bind|/usr/share|'
expect_text 'and that is said' "$scratch/err" "note: /usr/share is the environment's own"
command_line --out /var/lib/dpkg/nosuch/deeper
expect_words 'what is to be made, by the folder that will hold it' '--bind|/var/lib/dpkg|/var/lib/dpkg'
command_line --out /var/tmp/nosuch
expect_none 'what is to be made where all is seen' '|--bind|/var/tmp/nosuch'

command_line -- /usr/bin/cmake
expect_words 'a program that the root lacks' '--bind|/usr/bin/cmake|/usr/bin/cmake'
expect_words 'with the data of its name' '--ro-bind|/usr/share/cmake|/usr/share/cmake'
expect_words 'and libraries that the root lacks' '--setenv|LD_LIBRARY_PATH|/run/gnomon/lib'
expect_text 'each under its name' "$scratch/out" '^/run/gnomon/lib/libc\.so\.6$'
command_line -- cmake
expect_words 'a program named without its folder' '--bind|/usr/bin/cmake|/usr/bin/cmake'
: >"$root/usr/bin/cmake"
command_line -- /usr/bin/cmake
expect_none "a program that both have is the environment's" '|--bind|/usr/bin/cmake|'

# Drivers: a manifest, its library, and what that needs.
icd=/usr/share/vulkan/icd.d/lvp_icd.json
library=$(readlink -f /usr/lib/*-linux-gnu/libvulkan_lvp.so)
command_line --driver "$icd"
expect_words 'the library of a manifest, found by its bare name' "--ro-bind|$library|/run/gnomon/driver/1/libvulkan_lvp.so"
copy=$(sed -n "/^\/.*\/manifests\//{p;q;}" "$scratch/out")
expect_words 'the manifest in its place' "--ro-bind|$copy|$icd"
expect_text 'naming the library where it is inside' "$copy" '"library_path": "/run/gnomon/driver/1/libvulkan_lvp.so"'
expect_text 'with what the library needs' "$scratch/out" '^/run/gnomon/lib/libLLVM'
mkdir drivers
printf '{"ICD": {"library_path": "./lib/my.so", "api_version": "1.3.0"}}\n' >drivers/my.json
mkdir drivers/lib
cp "$library" drivers/lib/my.so
command_line --driver drivers/my.json
expect_none 'a driver that is seen as a whole stays as it is' '/run/gnomon/driver/'
expect_text 'but for what its library needs' "$scratch/out" '^/run/gnomon/lib/libLLVM'
printf '{"ICD": {"library_path": "%s"}}\n' "$library" >drivers/system.json
VK_DRIVER_FILES=$scratch/drivers/system.json:/nosuch.json command_line
expect_words 'a manifest named by the environment' "--ro-bind|$library|/run/gnomon/driver/1/${library##*/}"
printf '{"ICD": {"library_path": "libnosuch.so"}}\n' >drivers/broken.json
command_line --driver drivers/broken.json
expect_none 'a library that is nowhere is for the program to report' '/run/gnomon/driver/'
finish
