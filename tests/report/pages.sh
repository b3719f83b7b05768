#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Every HTML page as a browser has it. Skipped (77) where there is no Chromium: then make.sh here and check.py where there is one.
# usage: pages.sh GNOMON [CHROMIUM]
set -eu
here=$(dirname "$0")
chromium=${2:-$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)}
[ -n "$chromium" ] || { echo "SKIP: no Chromium here"; exit 77; }
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
sh "$here/make.sh" "$1" "$out"
python3 "$here/check.py" "$chromium" "$out" 8

# And a page on which each of its questions has an answer that it must not have.
mkdir "$out/bad"
cat > "$out/bad/bad.html" <<'PAGE'
<!doctype html><html><head><meta charset=utf-8><title>bad</title></head><body><main><h1 style="width:2000px">wide</h1>
<a href="#none">1</a><a href="none.html">2</a><img src="none.png"><input id=filter><span id=shown></span>
<table id=cases><tbody><tr><td>a.b</td></tr><tr><td>c.d</td></tr></tbody></table><script>console.log('said'); undefined_function();</script></main>
</body></html>
PAGE
if python3 "$here/check.py" "$chromium" "$out/bad" > "$out/said"; then
    echo "expected the bad page to fail"
    exit 1
fi
for text in 'no place #none' 'nowhere: none.html' 'cannot load' 'a picture' 'fetches' 'the filter box' 'said' 'undefined_function' 'the page:'; do
    grep -q -- "$text" "$out/said" && continue
    echo "expected '$text' of the bad page, found:"
    cat "$out/said"
    exit 1
done
