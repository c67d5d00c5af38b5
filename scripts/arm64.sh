#!/bin/sh
# Builds for arm64 and runs in an emulated processor: tests of lanes and rotations, and the fixed
# hashes of volumes and pictures, which are those of all other processors; by the libraries
# (tests/bits), and by the whole program (tests/recordings). Needs the packages that
# `scripts/setup.sh arm64` installs. The emulator's speed says nothing about a processor's.
#
#   scripts/arm64.sh [libraries | OPTIONS OF THE PROGRAM'S HASHES]
set -eu
cd "$(dirname "$0")/.."

target=aarch64-unknown-linux-musl
cargo test --locked --target $target -p sonoweave-simd -p sonoweave-core -p sonoweave-bits --lib --test bits
[ "${1:-}" != libraries ] || exit 0
messages=$(cargo build --locked --target $target --bin sonoweave --message-format=json-render-diagnostics)
program=$(printf '%s\n' "$messages" | sed -n 's/.*"executable":"\([^"]*\/sonoweave\)".*/\1/p')
[ -n "$program" ] || {
    echo "arm64: cargo did not name the program that it built" >&2
    exit 1
}
SONOWEAVE_SAMENESS_OF="qemu-aarch64 $program" cargo test --workspace --exclude sonoweave-figures \
    --exclude sonoweave-python --locked --test recordings -- sameness "$@"
