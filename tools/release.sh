#!/usr/bin/env bash
# Makes all files of a release and tries them: a wheel with the programs, an archive of the programs with man pages and completions, the
# Blender add-on, a source package, and their checksums. The same commit makes the same bytes. Nothing is published; docs/releasing.md says
# which command does.
#
#   tools/release.sh [FOLDER]          builds the commit into FOLDER [default: target/release-files], and tries it in a bare system
#   tools/release.sh --twice [FOLDER]  builds our own crates and all archives a second time, and compares every byte
#   tools/release.sh --try FOLDER      tries what is there
#
# Needs Rust, git, and Python with: pip install maturin ziglang cargo-zigbuild auditwheel (PYTHON names it). The trial needs debootstrap and
# root; user namespaces suffice where LTM_BARE_ROOT names a Debian root that is there already.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
mode=build
case "${1:-}" in
    --twice) mode=twice; shift ;;
    --try) mode=try; shift ;;
    -*) sed -n '2,12s/^# \{0,1\}//p' "$0"; exit 2 ;;
esac
target=${CARGO_TARGET_DIR:-target}
out=${1:-$target/release-files}
python=${PYTHON:-python3}
triple=x86_64-unknown-linux-gnu
# glibc of Debian 10, RHEL 8 and Ubuntu 20.04: what manylinux_2_28 means.
glibc=2.28
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
programs=(ltm ltm-pack ltm-unpack ltm-view)

step() { printf '\n== %s (%ss)\n' "$1" "$SECONDS"; }
fail() { echo "release.sh: $1" >&2; exit 1; }

SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
cargo_home=${CARGO_HOME:-$HOME/.cargo}
export SOURCE_DATE_EPOCH
# No path of this machine is part of what is made.
remapped="--remap-path-prefix=$cargo_home=/cargo --remap-path-prefix=$root=/ltm"
export RUSTFLAGS="${RUSTFLAGS:-} $remapped"
export CFLAGS="-ffile-prefix-map=$cargo_home=/cargo" CXXFLAGS="-ffile-prefix-map=$cargo_home=/cargo"
export CARGO_PROFILE_RELEASE_STRIP=symbols CARGO_PROFILE_RELEASE_DEBUG=0 CARGO_INCREMENTAL=0

# build FOLDER_OF_FILES
build() {
    local files=$1 work
    # The source package and the date are the commit's, the programs those of the working tree.
    [ -z "$(git status --porcelain)" ] || fail "the working tree is not the commit: commit or stash first"
    work=$(mktemp -d)
    mkdir -p "$files"
    rm -f "$files"/ltm-* "$files/SHA256SUMS"
    # Two folders: the two tools name their wrappers of zig differently, and each would build anew what the other has built.
    export CARGO_TARGET_DIR=$root/target/release-build/programs
    step "programs"
    PATH="$(dirname "$("$python" -c 'import sys; print(sys.executable)')"):$PATH" cargo zigbuild --release --locked \
        --target "$triple.$glibc" -p ltm-cli -p ltm-view --bin ltm --bin ltm-view --features ltm-cli/gpu,ltm-cli/s3
    local built=$CARGO_TARGET_DIR/$triple/release
    mkdir "$work/programs"
    for program in ltm ltm-view; do install -m 755 "$built/$program" "$work/programs/$program"; done
    # ltm has all of these two in it: a file of their own would be 4 MB each.
    for program in ltm-pack ltm-unpack; do
        printf '#!/bin/sh\nexec "$(dirname "$(readlink -f "$0")")/ltm" --as=%s "$@"\n' "$program" > "$work/programs/$program"
        chmod 755 "$work/programs/$program"
    done

    step "wheel"
    (cd tools/python && export CARGO_TARGET_DIR=$root/target/release-build/python &&
        "$python" -m maturin build --release --locked --zig --target "$triple" --compatibility manylinux_2_28 --out "$work/wheel")
    local wheel
    wheel=$(basename "$work"/wheel/*.whl)
    "$python" tools/release/archives.py wheel "$work/wheel/$wheel" "$work/programs" "$files/$wheel" LICENSE-MIT NOTICE

    step "archive of the programs"
    local folder=$work/ltm-$version-x86_64-linux
    mkdir -p "$folder"/bin "$folder"/share/{man/man1,bash-completion/completions,zsh/site-functions,fish/vendor_completions.d}
    install -m 755 "$work"/programs/* "$folder/bin"
    cp LICENSE-MIT NOTICE README.md CHANGELOG.md "$folder"
    for program in "${programs[@]}"; do
        "$folder/bin/$program" --write-man-pages "$folder/share/man/man1"
        "$folder/bin/$program" --write-completions bash > "$folder/share/bash-completion/completions/$program"
        "$folder/bin/$program" --write-completions zsh > "$folder/share/zsh/site-functions/_$program"
        "$folder/bin/$program" --write-completions fish > "$folder/share/fish/vendor_completions.d/$program.fish"
    done
    "$python" tools/release/archives.py tar "$folder" "$files/ltm-$version-x86_64-linux.tar.gz"

    step "Blender add-on, source package"
    # The manifest's own patterns, as Blender's command for building extensions takes them.
    "$python" tools/release/archives.py zip tools/blender "$files/ltm-blender-$version.zip" \
        '*/__pycache__/*' '/tests/*' '/measure_*.py' '*.zip'
    git archive --format=tar --prefix="ltm-$version/" HEAD | gzip -n -9 > "$files/ltm-$version-source.tar.gz"
    (cd "$files" && sha256sum -- ltm-* > SHA256SUMS)
    rm -rf "$work"
}

# What can be said of the files without a system to run them in.
inspect() {
    local files=$1 work wheel
    work=$(mktemp -d)
    step "inspection"
    wheel=$(echo "$files"/*.whl)
    "$python" -m auditwheel show "$wheel" | tee "$work/audit"
    tr '\n' ' ' < "$work/audit" | grep -q 'manylinux_2_28_x86_64' || fail "$wheel does not keep to manylinux_2_28"
    [ "$(stat -c %s "$wheel")" -le $((40 << 20)) ] || fail "$wheel is larger than 40 MiB"
    "$python" -m zipfile -e "$wheel" "$work/wheel"
    mkdir "$work/archive" && tar -xzf "$files/ltm-$version-x86_64-linux.tar.gz" -C "$work/archive"
    if grep -rlF -e "$cargo_home/" -e "$root/" "$work"; then fail "the files above name a path of this machine"; fi
    (cd "$files" && sha256sum --check --quiet SHA256SUMS && ls -l)
    rm -rf "$work"
}

# Installs the files in a system that has Python and nothing else of what built them, and runs tools/release/in_bare_system.sh there.
try_in_bare_system() {
    local files=$1 bare=${LTM_BARE_ROOT:-}
    step "a bare system"
    if [ -z "$bare" ]; then
        command -v debootstrap >/dev/null || { echo "no debootstrap: the release is not tried in a bare system"; return; }
        [ "$(id -u)" = 0 ] || { echo "not root: the release is not tried in a bare system; LTM_BARE_ROOT names one"; return; }
        bare=$root/target/bare-root
        if [ ! -e "$bare/usr/bin/python3" ]; then
            debootstrap --variant=minbase --include=python3,python3-venv bookworm "$bare"
        fi
    fi
    for tool in cargo rustc cc gcc make; do
        if [ -e "$bare/usr/bin/$tool" ]; then fail "$bare has $tool: it is not bare"; fi
    done
    rm -rf "$bare/release"
    mkdir -p "$bare/release/dependencies"
    cp "$files"/ltm-* "$files/SHA256SUMS" tools/release/in_bare_system.sh README.md "$bare/release"
    # What the package depends on comes from the package index, which the bare system does not reach.
    "$python" -m pip download --quiet --only-binary :all: --python-version 3.11 --platform manylinux_2_28_x86_64 \
        --platform manylinux2014_x86_64 --dest "$bare/release/dependencies" 'numpy>=1.23'
    local as_root=()
    if [ "$(id -u)" != 0 ]; then as_root=(--map-root-user); fi
    unshare "${as_root[@]}" --mount --pid --fork --net --mount-proc="$bare/proc" chroot "$bare" \
        /usr/bin/env -i PATH=/usr/bin:/bin HOME=/root LC_ALL=C.UTF-8 bash /release/in_bare_system.sh "$version"
}

case $mode in
    build | twice) build "$out"; inspect "$out" ;;
esac
if [ "$mode" = twice ]; then
    again=$(mktemp -d)
    for package in light-transport-matrix ltm-cli ltm-view; do
        cargo clean --quiet --release --target "$triple" --target-dir "$root/target/release-build/programs" -p "$package"
    done
    (cd tools/python && cargo clean --quiet --release --target "$triple" --target-dir "$root/target/release-build/python" \
        -p light-transport-matrix -p ltm-python)
    build "$again"
    step "the same bytes"
    diff -r "$out" "$again" || fail "two builds of one commit differ"
    rm -rf "$again"
fi
try_in_bare_system "$out"
step "done: $out"
