#!/usr/bin/env bash
# Everything that must hold before a change lands: format, lints, tests, documentation, the package, the demonstration.
# The README's test command for the whole workspace; the tests of a real window need Xvfb. LTM_REQUIRE_GPU=1 turns a
# missing adapter into a failure.
set -euo pipefail
cd "$(dirname "$0")/.."

step() { printf '\n== %s (%ss)\n' "$1" "$SECONDS"; }

step "format"
cargo fmt --all --check
step "lints"
cargo clippy --workspace --all-targets --locked -- -D warnings
step "the library without its features"
cargo clippy -p ltm --no-default-features --locked -- -D warnings
step "tests"
cargo test --workspace --locked
step "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked --document-private-items
step "the package of the library"
cargo publish --dry-run --allow-dirty --locked -p ltm
step "the demonstration, as the README's first command runs it"
demo=$(mktemp -d)
trap 'rm -rf "$demo"' EXIT
cargo run --release --locked -- demo --out "$demo/out"
test -s "$demo/out/all-on.png"
step "done"
