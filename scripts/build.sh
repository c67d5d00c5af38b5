#!/bin/sh
# Builds an optimised program and prints its path: sonoweave, as users run it, one that draws
# figures, or the one that writes measured figures into documents. The demo, the console's tests and
# the exchange with other programs use the first: the tests' own profile draws too few views a
# second. SONOWEAVE_RELEASE are cargo's options that select what is built, with the program among
# it.
#
#   scripts/build.sh [sonoweave|paper|pareto|accuracy|numbers]
set -eu
cd "$(dirname "$0")/.."

name=${1:-sonoweave}
case $name in
sonoweave) alone="--bin sonoweave" ;;
numbers) alone="-p sonoweave-checks --bin numbers" ;;
*) alone="-p sonoweave-figures --bin $name" ;;
esac
# shellcheck disable=SC2086 # options are words
messages=$(cargo build --release --locked ${SONOWEAVE_RELEASE:-$alone} --message-format=json-render-diagnostics)
# Cargo knows where it built to.
program=$(printf '%s\n' "$messages" | sed -n 's/.*"executable":"\([^"]*\/'"$name"'\)".*/\1/p' | tail -n 1)
[ -n "$program" ] || {
    echo "build: cargo did not name the program that it built" >&2
    exit 1
}
echo "$program"
