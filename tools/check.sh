#!/usr/bin/env bash
# Everything that must hold before a change lands: format, lints, tests, documentation.
# The README's test command and the window's tests at once; its tests of a real window need Xvfb. LTM_REQUIRE_GPU=1 turns a
# missing adapter into a failure.
set -euo pipefail
cd "$(dirname "$0")/.."

step() { printf '\n== %s (%ss)\n' "$1" "$SECONDS"; }

step "format"
cargo fmt --check
step "lints, the window's too"
cargo clippy --all-targets --locked --features view -- -D warnings
step "tests, the window's too"
cargo test --locked --features view
step "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --no-deps --locked --document-private-items
step "the demonstration, as the README's first command runs it"
demo=$(mktemp -d)
trap 'rm -rf "$demo"' EXIT
cargo run --release --locked -- demo --out "$demo/out"
test -s "$demo/out/all-on.png"
step "done"
