#!/bin/sh
# Checks what changed since the last commit, or since another: the format, the text and structure of
# all sources, and the lints and unit tests of the changed crates and of those that depend on them.
#
#   scripts/quick.sh [COMMIT]
#
# Integration tests are linted, not run. Only documents that are part of the program count. The
# figures are checked if they changed themselves: the crates that draw them take as long to build as
# everything else.
set -eu
cd "$(dirname "$0")/.."
began=$(date +%s)
say() { echo "quick: $*"; }

cargo fmt --all --check
make --no-print-directory style

commit=${1:-HEAD}
changed=$(git diff --name-only --relative "$commit" && git ls-files --others --exclude-standard)
tree() {
    cargo tree --workspace --exclude sonoweave-figures --exclude sonoweave-python --locked --prefix none "$@"
}
# Lines of a crate's name and its folder, relative to this one.
members=$(tree --depth 0 | sed -n "s#^\([^ ]*\) v.*($(pwd -P)/*\(.*\))\$#\1 \2#p")
[ -n "$members" ] || {
    say "cargo did not name the crates of the workspace" >&2
    exit 1
}

# A file belongs to the crate with the longest folder that contains it. Settings of the build belong
# to all crates, and other files at the root to none.
touched=$(
    printf '%s\n--\n%s\n' "$members" "$changed" | awk '
        $0 == "--" { files = 1; next }
        !files { crate[$2 == "" ? "" : $2 "/"] = $1; next }
        /^(Cargo\.toml|Cargo\.lock|clippy\.toml|rust-toolchain\.toml)$/ { for (folder in crate) print crate[folder]; next }
        /\.md$/ { next }
        {
            best = ""
            for (folder in crate) if (index($0, folder) == 1 && length(folder) > length(best)) best = folder
            if (best != "" || /^(src|tests|benches|docs\/examples|docs\/phantom)\//) print crate[best]
        }' | sort -u
)

# check PACKAGE…: lints and unit tests.
check() {
    targets=--bins
    for package in "$@"; do
        folder=$(printf '%s\n' "$members" | awk -v name="$package" '$1 == name { print $2 }')
        # Cargo refuses to test libraries where there is none.
        [ ! -f "${folder:-.}/src/lib.rs" ] || targets=--lib
    done
    say "$*"
    selected=$(printf -- '-p %s ' "$@")
    # shellcheck disable=SC2086 # options are words
    cargo clippy $selected --tests --locked -- -D warnings
    # shellcheck disable=SC2086
    scripts/test.sh $selected $targets --locked
}

checked=
if [ -n "$touched" ]; then
    # Crates that depend on a crate in their tests alone count, too. With the program's own crate,
    # every selection shares the build of `make test`.
    # shellcheck disable=SC2046 # names are words
    affected=$({ echo sonoweave && tree --edges normal,build,dev $(printf -- '--invert %s ' $touched); } | sed 's/ v.*//' | sort -u | sed '/^$/d')
    # shellcheck disable=SC2086
    check $affected
    checked=yes
fi
# Alone, as with them dependencies have other features.
if printf '%s\n' "$changed" | grep -q '^figures/'; then
    members="sonoweave-figures figures"
    check sonoweave-figures
    checked=yes
fi
# Its tests are those of `make python`.
if printf '%s\n' "$changed" | grep -q '^python/'; then
    say sonoweave-python
    cargo clippy -p sonoweave-python --locked -- -D warnings
    checked=yes
fi
[ -n "$checked" ] || say "the format is right; no crate changed since $commit"
say "passed in $(($(date +%s) - began)) s"
