# SPDX-License-Identifier: Apache-2.0
# The package list, and that what is made from it is made from it alone.
. "${0%/*}/common.sh"

list=$source/.ci/packages.txt
packages=$(sed -e 's/#.*//' -e '/^[[:space:]]*$/d' "$list")
[ "$(printf '%s\n' "$packages" | wc -l)" -ge 10 ] || fail "expected at least 10 packages in $list, found: $packages"
malformed=$(printf '%s\n' "$packages" | grep -v -E '^[a-z0-9][a-z0-9+.-]+$')
[ -z "$malformed" ] || fail "no names of packages: $malformed"
repeated=$(printf '%s\n' "$packages" | sort | uniq -d)
[ -z "$repeated" ] || fail "listed twice: $repeated"
for package in $packages; do
    state=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)
    [ "$state" = installed ] || fail "$package: expected to be installed where the tests run, found '$state'"
done

# A package named elsewhere would be a second list.
for file in gnomon .ci/Dockerfile .ci/run; do
    for package in $packages; do
        grep -q -w -e "$package" "$source/$file" && case $package in
        cmake | clang) [ "$file" != .ci/Dockerfile ] || fail "$file names $package itself" ;; # commands and presets of that name
        mesa-vulkan-drivers) [ "$file" = gnomon ] || fail "$file names $package itself" ;; # what `driver add` brings of another suite
        *) fail "$file names $package itself" ;;
        esac
    done
done
expect_text 'the image is Debian 13' "$source/.ci/Dockerfile" '^FROM debian:trixie$'
expect_text 'the image is made from the list' "$source/.ci/Dockerfile" '^COPY .ci/packages.txt '
expect_text 'all of it is installed' "$source/.ci/Dockerfile" 'xargs apt-get install -y'

for file in gnomon .ci/run; do
    [ -x "$source/$file" ] || fail "$file is not executable"
done
expect_status 'the wrapper is POSIX shell' 0 dash -n "$gnomon"
expect_status 'the CI script is well formed' 0 bash -n "$source/.ci/run"
expect_text 'CI runs what the README says' "$source/.ci/run" '^exec ./gnomon test$'
finish
