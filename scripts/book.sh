#!/bin/sh
# Makes the book of the pages in docs: out/book/index.html. mdBook builds it; cargo installs it for
# the first book, which takes minutes.
set -eu
cd "$(dirname "$0")/.."

version=0.5.4
tool=out/tools/bin/mdbook
"$tool" --version 2>/dev/null | grep -qF "v$version" ||
    cargo install mdbook --locked --quiet --version "$version" --root out/tools
log=$(mktemp)
trap 'rm -f "$log"' EXIT
"$tool" build docs 2>&1 | tee "$log"
# A page that is named and missing, or a part that mdBook cannot read, is a warning to it.
! grep -q -e WARN -e ERROR "$log"
echo "book: $PWD/out/book/index.html"
