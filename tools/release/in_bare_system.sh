#!/usr/bin/env bash
# Run by tools/release.sh inside a system that has Python and nothing else: installs what was made, and runs its programs and those commands
# of the README that need no compiler.
set -euo pipefail
version=$1
cd "$(mktemp -d)"

# Runs a command that the README has, word for word.
readme() {
    grep -qF -- "$1" /release/README.md || { echo "the README has no: $1" >&2; exit 1; }
    echo "\$ $1"
    eval "$1"
}

begun=$SECONDS
python3 -m venv venv
. venv/bin/activate
# From the files at hand and not from the package index.
export PIP_NO_INDEX=1 PIP_FIND_LINKS="/release /release/dependencies" PIP_DISABLE_PIP_VERSION_CHECK=1
echo '$ pip install ltm'
pip install ltm
echo "installed after $((SECONDS - begun)) s"
for program in ltm ltm-pack ltm-unpack ltm-view; do
    said=$("$program" --version)
    [ "${said##* }" = "$version" ] || { echo "$program says $said" >&2; exit 1; }
done
python3 -c 'import ltm; print("import ltm", ltm.__version__)'
python3 - <<'PYTHON'
import subprocess, sys, time
best = min(
    (lambda begun: (subprocess.run([sys.executable, "-c", "import ltm"], check=True), time.perf_counter() - begun)[1])(time.perf_counter())
    for _ in range(5)
)
print(f"a process that imports ltm takes {best:.3f} s")
PYTHON
ltm
ltm doctor
ltm demo --no-window
echo "the demonstration ended $((SECONDS - begun)) s after the beginning of the installation"
test -s out/all-on.png && test -s out/demo.ltc

# A scene of one's own.
cat > room.obj <<'OBJ'
mtllib room.mtl
v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
v -0.5 2 -0.5
v 0.5 2 -0.5
v 0.5 2 0.5
v -0.5 2 0.5
usemtl floor
f 4 3 2 1
usemtl lamp
f 5 6 7 8
OBJ
printf 'newmtl floor\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 3 2 1\n' > room.mtl
printf 'geometry = ["room.obj"]\n[camera]\neye = [0, 1, 3]\nlook_at = [0, 0.5, 0]\nwidth = 64\nheight = 48\n' > scene.toml
printf '[[light]]\nname = "lamp"\nstops = -1.0\n' > look.toml
ltm
readme "ltm render scene.toml --pack --error 2%"
readme "ltm relight scene.ltc --lighting look.toml -o look.png"
test -s look.png
ltm-unpack scene.ltc -o lights.exr
ltm-pack lights.exr -o again.ltc
ltm share scene.ltc -o site
test -s site/index.html
# Without a display the window says in one line what it lacks.
if ltm view scene.ltc > window.log 2>&1; then echo "a window without a display?" >&2; exit 1; fi
cat window.log
[ "$(wc -l < window.log)" -le 2 ] || { echo "more than a line" >&2; exit 1; }
deactivate

# The archive.
tar -xzf "/release/ltm-$version-x86_64-linux.tar.gz"
cd "ltm-$version-x86_64-linux"
for program in ltm ltm-pack ltm-unpack ltm-view; do
    "bin/$program" --version
    test -s "share/man/man1/$program.1"
    test -s "share/bash-completion/completions/$program"
done
python3 -m zipfile -l "/release/ltm-blender-$version.zip" | grep -q blender_manifest.toml
tar -tzf "/release/ltm-$version-source.tar.gz" "ltm-$version/Cargo.toml" > /dev/null
echo "all of the release works here"
