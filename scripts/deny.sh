#!/usr/bin/env bash
# Compares the crates with deny.toml, and with the advisories of RustSec, by cargo-deny. It is built
# and installed if it is missing.
#
#   scripts/deny.sh
#
# The advisories are fetched. Where they cannot be, this fails, unless DENY_OPTIONAL=1; it then says
# that they were not checked.
set -euo pipefail
cd "$(dirname "$0")/.."

command -v cargo-deny >/dev/null || {
    echo "deny: cargo-deny is missing; building it takes minutes"
    cargo install --quiet --locked cargo-deny
}
cargo deny --locked check licenses bans sources
if ! cargo deny --locked fetch db; then
    echo "deny: NOT CHECKED: advisories, as RustSec's database could not be fetched" >&2
    [ "${DENY_OPTIONAL:-}" = 1 ] && exit 0
    echo "deny: run it where the network reaches the database, or with DENY_OPTIONAL=1" >&2
    exit 1
fi
cargo deny --locked check --disable-fetch advisories
