# SPDX-License-Identifier: Apache-2.0
# Exit statuses and messages of what the wrapper answers by itself.
. "${0%/*}/common.sh"

expect_status 'no command' 2 "$gnomon"
expect_text 'no command says how' "$scratch/err" '^usage: '
for word in help --help -h; do
    expect_status "$word" 0 "$gnomon" $word
    expect_text "$word says how, on stdout" "$scratch/out" '^usage: '
done
expect_status 'unknown preset of test' 2 "$gnomon" test --preset nosuch
expect_text 'the message names the preset' "$scratch/err" "unknown preset 'nosuch'; expected "
expect_status 'preset without its value' 2 "$gnomon" test --preset
expect_status 'unknown option of test' 2 "$gnomon" test --nosuch
expect_text 'the message names the option' "$scratch/err" 'unknown option --nosuch'
expect_status 'unknown preset of build' 2 "$gnomon" build nosuch
expect_status 'build with two presets' 2 "$gnomon" build release debug
expect_status 'setup with an argument' 2 "$gnomon" setup now
expect_status 'driver without an action' 2 "$gnomon" driver
expect_status 'a driver without its suite' 2 "$gnomon" driver add mine
expect_text 'the message names what is missing' "$scratch/err" 'expected --suite'
expect_status 'a driver with a name that is a path' 2 "$gnomon" driver add ../mine --suite sid
expect_status 'a driver with the name of our own' 2 "$gnomon" driver add lavapipe --suite sid
expect_status 'removing what is not there' 2 "$gnomon" driver remove mine
expect_status 'removing a path' 2 "$gnomon" driver remove ..
expect_status 'unknown environment' 2 env GNOMON_ENVIRONMENT=nosuch "$gnomon" setup
expect_text 'the message names the choices' "$scratch/err" "'nosuch'; expected private or host"
expect_status 'cache that cannot be made' 3 env GNOMON_ENVIRONMENT=private GNOMON_CACHE=/proc/nosuch "$gnomon" setup
expect_text 'the message names the folder and the way out' "$scratch/err" '/proc/nosuch; set GNOMON_CACHE'

# The environment that the tests run in is complete, so set-up has nothing to do there.
expect_status 'setup in a complete environment' 0 env GNOMON_ENVIRONMENT=host "$gnomon" setup
expect_text 'nothing is installed' "$scratch/err" '^gnomon: the environment is ready: this host$'
[ "$(wc -l <"$scratch/err")" = 1 ] || fail "setup in a complete environment did more: $(cat "$scratch/err")"

expect_status 'a command in the environment' 0 env GNOMON_ENVIRONMENT=host "$gnomon" shell true
expect_status 'its status comes back' 33 env GNOMON_ENVIRONMENT=host "$gnomon" shell sh -c 'exit 33'

# Through a symbolic link, from another folder, with a space in the path.
mkdir "$scratch/a b"
ln -s "$gnomon" "$scratch/a b/link"
cd "$scratch/a b" || exit 1
expect_status 'through a symbolic link' 0 env GNOMON_ENVIRONMENT=host ./link setup
mkdir -p "$scratch/half"
cp "$gnomon" "$scratch/half/"
expect_status 'an incomplete clone' 3 "$scratch/half/gnomon" setup
expect_text 'the message says what is missing' "$scratch/err" 'lacks .ci/packages.txt'
finish
