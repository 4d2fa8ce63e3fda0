#!/usr/bin/env bash
# Checks deny.toml with cargo-deny, where it is installed: licences, bans and sources, and where the database of
# advisories can be fetched, these. Says what it leaves out.
set -eu
cd "$(dirname "$0")/.."

if ! command -v cargo-deny >/dev/null; then
    echo "deny: no cargo-deny found, the check is left out; \`cargo install cargo-deny\` brings it"
    exit 0
fi
cargo deny --locked check licenses bans sources
if cargo deny fetch db >/dev/null 2>&1; then
    cargo deny --locked check advisories
else
    echo "deny: the database of advisories cannot be fetched, their check is left out"
fi
