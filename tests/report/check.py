#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""
Opens every HTML page below a folder in headless Chromium and asks what a reader would notice: links that lead nowhere, a
filter box that does not filter, errors on the console, anything fetched from elsewhere, text that runs over its border, a page wider than the
window; by day and by night, narrow and wide.
usage: check.py CHROMIUM FOLDER [PAGES]
PAGES: how many pages there have to be at least (default 1).
"""
import json
import os
import re
import subprocess
import sys
import tempfile
import urllib.parse

# Before anything else of the page, so that its own policy does not forbid it.
SCRIPT = """<script>
var gnomonErrors = [];
addEventListener('error', function (e) { gnomonErrors.push(e.message || 'cannot load ' + (e.target.src || e.target.href)); }, true);
addEventListener('securitypolicyviolation', function (e) { gnomonErrors.push('policy: ' + e.violatedDirective + ' ' + e.blockedURI); });
addEventListener('load', function () {
    var found = {errors: gnomonErrors, links: [], fetched: [], over: [], filter: null};
    document.querySelectorAll('a[href]').forEach(function (a) {
        var href = a.getAttribute('href');
        if (href[0] != '#') found.links.push(href);
        else if (!document.getElementById(decodeURIComponent(href.slice(1)))) gnomonErrors.push('no place ' + href);
    });
    performance.getEntriesByType('resource').forEach(function (r) { found.fetched.push(r.name.slice(0, 80)); });
    document.querySelectorAll('img').forEach(function (i) { if (!i.naturalWidth) gnomonErrors.push('a picture cannot be shown'); });
    document.querySelectorAll('.tile b, .tile span, .verdict, .badge, h1, h2').forEach(function (e) {
        if (e.scrollWidth > e.clientWidth + 1 && e.clientWidth) found.over.push(e.textContent.slice(0, 60));
        var outer = e.parentElement.getBoundingClientRect(), inner = e.getBoundingClientRect();
        if (inner.right > outer.right + 1) found.over.push(e.textContent.slice(0, 60));
    });
    if (document.documentElement.scrollWidth > innerWidth + 1)
        found.over.push('the page: ' + document.documentElement.scrollWidth + ' of ' + innerWidth + ' pixels');
    var box = document.getElementById('filter');
    if (box) {
        var rows = Array.from(document.querySelectorAll('#cases tbody tr'));
        var type = function (text) {
            box.value = text;
            box.dispatchEvent(new Event('input'));
            return rows.filter(function (r) { return r.offsetParent !== null; });
        };
        var folded = document.querySelector('#cases').closest('details');
        if (folded) folded.open = true;
        var first = rows.length ? rows[0].cells[0].textContent.trim() : '';
        var word = first.split('.').pop(), want = rows.filter(function (r) { return r.textContent.toLowerCase().indexOf(word.toLowerCase()) >= 0; });
        found.filter = {
            rows: rows.length, word: word, shown: type(word.toUpperCase()).length, want: want.length, said: parseInt(document.getElementById('shown').textContent),
            nothing: type(first + ' no-such-word').length, all: type('').length
        };
    }
    document.documentElement.innerHTML = '<pre>GNOMON' + encodeURIComponent(JSON.stringify(found)) + 'END</pre>';
});
</script>"""

# What a page may fetch from: nothing but itself.
FETCHED = re.compile(r"""(?:\bsrc(?:set)?\s*=\s*["']?|\burl\(["']?|<link[^>]*href=["']?|@import\s+["']?)(?!data:|#)([^"'\s>)]+)""")
WINDOWS = [(420, False), (900, True), (1400, False)]
failures = 0


def fail(page, text):
    global failures
    failures += 1
    print(f"FAILED {page}: {text}")


def ask(chromium, folder, path, width, dark):
    """What the page says of itself in a window so wide, and what Chromium wrote on its console."""
    with open(path, encoding="utf-8") as file:
        page = file.read()
    at = page.find("<meta")
    if at < 0:
        raise ValueError("expected <meta")
    changed = page[:at] + SCRIPT + page[at:]
    copy = os.path.join(folder, "page.html")
    with open(copy, "w", encoding="utf-8") as file:
        file.write(changed)
    command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", f"--window-size={width},900",
               f"--user-data-dir={folder}/profile", "--host-resolver-rules=MAP * ~NOTFOUND", "--enable-logging=stderr",
               "--virtual-time-budget=4000", "--dump-dom"]
    if dark:
        command.append("--blink-settings=preferredColorScheme=0")
    done = subprocess.run(command + ["file://" + copy], capture_output=True, text=True, timeout=120)
    match = re.search(r"GNOMON([^<]*)END", done.stdout)
    if not match:
        raise ValueError(f"no answer, exit status {done.returncode}: {done.stderr[-300:]}")
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return json.loads(urllib.parse.unquote(match.group(1))), console


def check(chromium, folder, path, root):
    """Whether the page has a filter box."""
    page = os.path.relpath(path, root)
    filters = False
    with open(path, encoding="utf-8") as file:
        for name in FETCHED.findall(file.read()):
            fail(page, f"fetches {name[:80]}")
    for width, dark in WINDOWS:
        where = f"{page}, {width} pixels{', by night' if dark else ''}"
        try:
            found, console = ask(chromium, folder, path, width, dark)
        except (ValueError, subprocess.TimeoutExpired) as error:
            fail(where, str(error))
            continue
        for error in found["errors"] + console:
            fail(where, error)
        for name in found["fetched"]:
            if not name.startswith("data:"):
                fail(where, f"fetches {name}")
        for text in found["over"]:
            fail(where, f"runs over its border: {text}")
        for link in found["links"]:
            target, _, place = urllib.parse.unquote(link).partition("#")
            file = os.path.join(os.path.dirname(path), target)
            if "://" in link or not os.path.exists(file):
                fail(where, f"a link leads nowhere: {link}")
            elif place and f'id="{place}"' not in open(file, encoding="utf-8").read():
                fail(where, f"a link leads nowhere: {link}")
        box = found["filter"]
        filters = filters or box is not None
        if box and box["rows"] and not (0 < box["shown"] == box["want"] == box["said"] and box["nothing"] == 0 and box["all"] == box["rows"]):
            fail(where, f"the filter box: {box}")
    return filters


def main():
    chromium, root = sys.argv[1], os.path.abspath(sys.argv[2])
    least = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    pages = sorted(os.path.join(at, name) for at, _, names in os.walk(root) for name in names if name.endswith(".html"))
    boxes = 0
    with tempfile.TemporaryDirectory() as folder:
        for path in pages:
            boxes += check(chromium, folder, path, root)
    if len(pages) < least:
        fail(root, f"expected at least {least} pages, found {len(pages)}")
    print(f"{len(pages)} pages, {boxes} filter boxes, each in {len(WINDOWS)} windows; {failures} failed")
    return failures > 0


sys.exit(main())
