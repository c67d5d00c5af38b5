#!/bin/sh
# Builds the optimised program, as users run it, and prints its path. The demo, the console's tests
# and the exchange with other programs use it: the tests' own profile draws too few views a second.
# SONOWEAVE_RELEASE are cargo's options that select what is built, with the program among it.
set -eu
cd "$(dirname "$0")/.."

# shellcheck disable=SC2086 # options are words
messages=$(cargo build --release --locked ${SONOWEAVE_RELEASE:---bin sonoweave} --message-format=json-render-diagnostics)
# Cargo knows where it built to.
program=$(printf '%s\n' "$messages" | sed -n 's/.*"executable":"\([^"]*\/sonoweave\)".*/\1/p' | tail -n 1)
[ -n "$program" ] || {
    echo "build: cargo did not name the program that it built" >&2
    exit 1
}
echo "$program"
