#!/usr/bin/env bash
# Proves the console's page in a real browser: a session at the virtual bedside, its page in Debian's Chromium, looked at, steered, hidden, cut off and found again.
#
# What is missing is installed: node, npm and chromium as Debian packages, and the packages of tests/console/package.json, some 20 MB, into out/console-test, from the
# registry that npm is set up for. Nothing else outside of that folder is changed. SONOWEAVE names another program than the one that cargo builds. Pictures of the page
# are in out/console-test afterwards. With the word "reach" it measures instead what pages attain and cost (tests/console/reach.js).
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "console: $*"; }

place=out/console-test
mkdir -p "$place"
# What was installed is what is wanted; a half-made folder is made anew.
if ! cmp -s tests/console/package-lock.json "$place/installed.json"; then
    cp tests/console/package.json tests/console/package-lock.json "$place/"
    (cd "$place" && npm ci --ignore-scripts --no-audit --no-fund --loglevel=error) || {
        say "the packages of tests/console/package.json could not be installed from the registry that npm is set up for; its message is above." >&2
        exit 1
    }
    cp tests/console/package-lock.json "$place/installed.json"
fi

if [ -z "${SONOWEAVE:-}" ]; then
    cargo build --release --locked
    SONOWEAVE=$(cd "${CARGO_TARGET_DIR:-target}/release" && pwd)/sonoweave
fi
export SONOWEAVE
CHROMIUM=$(command -v chromium)
export CHROMIUM
rm -rf "$place"/session-* "$place"/*.png
if [ "${1:-}" = reach ]; then
    exec node tests/console/reach.js
fi
# One file: its tests run one after the other.
node --test-reporter=spec tests/console/main.js
say "pictures of the page are in $place"
