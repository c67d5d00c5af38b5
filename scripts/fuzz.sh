#!/bin/sh
# Searches for bytes that break a decoder or a reader of files.
#
#   scripts/fuzz.sh [TARGET…]       all targets by default, FUZZ_SECONDS (60) each
#
# Inputs that reach new code are kept in out/fuzz. Inputs that break something are named at the end.
# They belong into the corpus beside their target, in drivers/fuzz or tests/fuzz, where the tests
# try them again.
set -eu
cd "$(dirname "$0")/.."

# Nothing is tried without these. That is a failure, unless FUZZ_OPTIONAL=1 asks for no more.
lacks() {
    echo "fuzz: nothing was tried: it needs $1. FUZZ_OPTIONAL=1 accepts that." >&2
    [ "${FUZZ_OPTIONAL:-}" = 1 ] || exit 1
    exit 0
}
cargo +nightly --version >/dev/null 2>&1 ||
    lacks "a nightly compiler (rustup toolchain install nightly --profile minimal)"
cargo fuzz --version >/dev/null 2>&1 || lacks "cargo-fuzz (cargo install cargo-fuzz --locked)"

# Targets that read files write them first, which is three times as fast in memory.
if TMPDIR=$(mktemp -d -p /dev/shm 2>/dev/null); then
    export TMPDIR
    trap 'rm -rf "$TMPDIR"' EXIT
else
    unset TMPDIR
fi
seconds=${FUZZ_SECONDS:-60}
host=$(rustc -vV | sed -n 's/^host: //p')
targets() { sed -n 's/^name = "\(.*\)"$/\1/p' "$1/Cargo.toml" | sed 1d; }
[ $# -gt 0 ] || set -- $(targets drivers/fuzz) $(targets tests/fuzz)
broken=
for target in "$@"; do
    folder=drivers/fuzz
    [ -f "$folder/fuzz_targets/$target.rs" ] || folder=tests/fuzz
    mkdir -p "out/fuzz/$target"
    echo "fuzz: $target for $seconds s"
    # Inputs become as long as the longest of the corpus, a session of 34 KB. The host is named
    # because a cargo-fuzz that was built for musl would build for musl.
    cargo +nightly fuzz run --fuzz-dir "$folder" --target-dir "${CARGO_TARGET_DIR:-target}/fuzz" --target "$host" "$target" \
        "out/fuzz/$target" "$folder/corpus/$target" -- -max_total_time="$seconds" -timeout=10 -rss_limit_mb=512 -print_final_stats=1 ||
        broken="$broken $target"
done
if [ -n "$broken" ]; then
    echo "fuzz: broken:$broken; the inputs are in drivers/fuzz/artifacts and tests/fuzz/artifacts, in a folder each."
    exit 1
fi
