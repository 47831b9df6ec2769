#!/usr/bin/env bash
# Everything that must hold before a change lands: format, lints, tests, documentation, the package, the demonstration, the Python
# package, the shared page, and the Blender add-on where bpy is; the oldest Rust, dependencies, the public interface and the book where
# their tools are. The tests of a real window need Xvfb. LTM_REQUIRE_GPU=1 turns a missing adapter into a failure.
# LTM_CHECK_PROFILE=release builds what is checked after the tests as its users build it; without it that is built as the tests are, which
# takes less time.
set -euo pipefail
cd "$(dirname "$0")/.."
profile=${LTM_CHECK_PROFILE:-dev}
if [ "$profile" = dev ]; then built=debug; else built=$profile; fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

step() { printf '\n== %s (%ss)\n' "$1" "$SECONDS"; }

# What the tests of the Python package and of the page want from their registries comes while Rust is built. A failure is not one
# here: the steps below ask again, and say what is missing.
fetch() {
    if python3 -c 'import sys, tomllib, venv, ensurepip' 2>/dev/null; then
        python3 -m venv "$work/venv"
        # shellcheck disable=SC2046
        "$work/venv/bin/pip" install --quiet $(python3 -c 'import tomllib
with open("tools/python/pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
extras = (project["optional-dependencies"][extra] for extra in ("test", "farm", "slurm"))
print(*project["dependencies"], *sum(extras, []))') openjd-cli
    fi
    if command -v npm; then
        (cd page && npm ci --silent --no-audit --no-fund)
    fi
}
fetch >/dev/null 2>&1 &
fetching=$!
linting=
trap 'kill $fetching $linting 2>/dev/null || true; rm -rf "$work"' EXIT

# With fewer features half of the crates are checked anew. That is done while the tests of the Python package and of the page wait: for
# workers, daemons, a browser.
lint_with_fewer_features() {
    cargo clippy -p light-transport-matrix --no-default-features --locked -- -D warnings &&
        cargo clippy -p ltm-cli --locked -- -D warnings
}
begin_lints() {
    if [ -z "$linting" ]; then
        lint_with_fewer_features >"$work/lints" 2>&1 &
        linting=$!
    fi
}

step "format"
cargo fmt --all --check
step "lints"
cargo clippy --workspace --all-targets --locked -- -D warnings
step "tests"
cargo test --workspace --locked
step "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked --document-private-items
step "the package of the library"
# Without its own build, which shares nothing with the others: what is in the package is checked below, and does.
cargo publish --dry-run --no-verify --allow-dirty --locked -p light-transport-matrix
packed=$work/package
mkdir "$packed"
cargo package --no-verify --allow-dirty --locked -p light-transport-matrix
target=${CARGO_TARGET_DIR:-target}
tar -xzf "$target"/package/light-transport-matrix-*.crate -C "$packed" --strip-components 1
cargo check --manifest-path "$packed/Cargo.toml" --target-dir "$target" --examples --all-features
step "the oldest Rust"
oldest=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
if rustc --version | grep -q "^rustc $oldest\."; then
    echo "rust-version $oldest is that of this toolchain, which has built everything above"
elif rustup run "$oldest" rustc --version >/dev/null 2>&1; then
    rustup run "$oldest" cargo check --workspace --locked --target-dir "$target/oldest"
else
    echo "no toolchain $oldest: rust-version is not checked"
fi
step "licences and advisories of dependencies"
if cargo deny --version >/dev/null 2>&1; then
    cargo deny --workspace check licenses bans sources
    if cargo deny fetch db >/dev/null 2>&1; then
        cargo deny --workspace check advisories
    else
        echo "no database of advisories can be reached: they are not checked"
    fi
else
    echo "no cargo-deny: licences and advisories are not checked"
fi
step "the public interface"
# Against the last release: the newest tag, or what LTM_BASELINE names.
baseline=${LTM_BASELINE:-$(git describe --tags --abbrev=0 --match 'v*' 2>/dev/null || true)}
if ! cargo semver-checks --version >/dev/null 2>&1; then
    echo "no cargo-semver-checks: the public interface is not checked"
elif [ -z "$baseline" ]; then
    echo "no released version to compare with (no tag v*, no LTM_BASELINE): the public interface is not checked"
else
    cargo semver-checks -p light-transport-matrix --baseline-rev "$baseline"
fi
step "the book"
if command -v mdbook >/dev/null; then
    mdbook build --dest-dir "$(realpath "$target")/book"
else
    echo "no mdbook: the book is not built"
fi
step "the demonstration"
demo=$work/demo
if [ "$profile" = dev ]; then
    # As the tests have built it: alone it would be built anew, with fewer features of what it is built of.
    "$target/debug/ltm" demo --no-window --samples 4 --size 320x180 --out "$demo/out"
else
    cargo run --profile "$profile" --locked -- demo --no-window --out "$demo/out"
fi
test -s "$demo/out/all-on.png"
step "the Python package, installed into a fresh environment"
wait "$fetching" || true
if python3 -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
    # Of crates as the workspace has built them, see `as-workspace` in the manifest; for users without.
    features=()
    if [ "$profile" = dev ]; then features=(--features as-workspace); fi
    (cd tools/python && cargo fmt --check && cargo clippy --profile "$profile" "${features[@]}" --locked -- -D warnings)
    python3 -m venv "$work/venv"
    if "$work/venv/bin/pip" download --quiet --no-deps --dest "$work/wheels" numpy; then
        MATURIN_PEP517_ARGS="--profile $profile ${features[*]}" \
            "$work/venv/bin/pip" install --quiet './tools/python[test,farm,slurm]' openjd-cli
        begin_lints
        # More processes than processors: two thirds of the time is waiting for workers, daemons, kernels and a bad network.
        LTM=$(realpath "$target/$built/ltm") "$work/venv/bin/python" -m pytest --quiet -n 4 --dist loadgroup tools/python
    else
        echo "no package index can be reached: the Python package is not tested"
    fi
else
    echo "no python3 of 3.10 or newer with venv: the Python package is not tested"
fi
begin_lints
step "the Blender add-on"
# bpy is 300 MB and wants one version of Python, so that it is used where it is and not fetched. LTM_PYTHON names the Python that has it.
python=${LTM_PYTHON:-python3}
if "$python" -c 'import bpy, numpy, pytest' 2>/dev/null; then
    LTM="$target/$built/ltm" "$python" -m pytest --quiet tools/blender
else
    echo "no Python with bpy, numpy and pytest: the Blender add-on is not tested"
fi
step "the shared page: its types, and tests in a browser"
if node -e 'process.exit(process.versions.node.split(".")[0] < 20 ? 1 : 0)' 2>/dev/null && command -v npm >/dev/null; then
    ltm=$(realpath "$target/$built/ltm")
    if (cd page && npm ci --silent --no-audit --no-fund); then
        (cd page && npm run --silent types)
        if [ -x "${CHROMIUM:-/usr/bin/chromium}" ]; then
            (cd page && LTM="$ltm" npm test --silent)
        else
            echo "no chromium: the shared page is not tested in a browser"
        fi
    else
        echo "no npm registry can be reached: the shared page is not tested in a browser"
    fi
else
    echo "no node of 20 or newer with npm: the shared page is not tested in a browser"
fi
step "the library and the programs without their features"
wait "$linting" || { cat "$work/lints"; exit 1; }
step "done"
