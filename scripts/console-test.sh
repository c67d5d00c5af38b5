#!/usr/bin/env bash
# Tests the console's page in Debian's Chromium: a session at the virtual bedside is viewed,
# steered, hidden, disconnected and found again.
#
#   scripts/console-test.sh [reach|pictures]     measures instead (tests/console/reach.js), or makes
#                                                the documents' pictures (tests/console/pictures.js)
#
# Missing Debian packages are installed by scripts/setup.sh. The packages of
# tests/console/package.json (20 MB) are installed into out/console-test, from the registry that npm
# is set up for. SONOWEAVE names another program than the one that cargo builds. Pictures of the
# page are written to out/console-test.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "console: $*"; }

place=out/console-test
mkdir -p "$place"
# The lock file is copied last: a folder without it is incomplete, and is made again.
if ! cmp -s tests/console/package-lock.json "$place/installed.json"; then
    cp tests/console/package.json tests/console/package-lock.json "$place/"
    (cd "$place" && npm ci --ignore-scripts --no-audit --no-fund --loglevel=error) || {
        say "the packages of tests/console/package.json could not be installed from the registry that npm is set up for; its message is above." >&2
        exit 1
    }
    cp tests/console/package-lock.json "$place/installed.json"
fi

if [ -z "${SONOWEAVE:-}" ]; then
    SONOWEAVE=$(scripts/build.sh)
fi
export SONOWEAVE
CHROMIUM=$(command -v chromium)
export CHROMIUM
rm -rf "$place"/session-* "$place"/*.png
case ${1:-} in
reach | pictures) exec node "tests/console/$1.js" ;;
esac
# One file, so that its tests run one after the other.
node --test-reporter=spec tests/console/main.js
say "pictures of the page are in $place"
