#!/usr/bin/env bash
# All that wants a GPU, on a machine that has one: relighting, paging and parity with the CPU, the window, and then the rates of the
# GPU's memory and bus with those of relighting beside them. Prints one table; exit code 1 if a test fails. An adapter in software runs
# it all too, and is called software. LTM_GPU_PROFILE names cargo's profile: bench, or dev where only the tests matter.
#
#   tools/gpu.sh                 builds and runs
#   tools/gpu.sh --build FOLDER  builds all of it into a folder, for a machine that has a GPU and no Rust
#   tools/gpu.sh --run FOLDER    runs what such a folder holds, in a checkout that stands at the same path as the one it was built in
set -uo pipefail
cd "$(dirname "$0")/.."
export LTM_REQUIRE_GPU=1

# The tests, by the names that cargo and a folder know them by.
tests=("relight_gpu" "gpu_cli" "view" "view_window")
profile=${LTM_GPU_PROFILE:-bench}
# One set of features for all tests, so that nothing is built twice.
build=(cargo test --workspace --locked)
bench=(cargo bench --locked --profile "$profile" --bench gpu)
mode=${1:-here}
folder=${2:-}
case "$mode" in
    here) ;;
    --build | --run) [ -n "$folder" ] || { echo "gpu.sh: $mode needs a folder" >&2; exit 2; } ;;
    *) sed -n '2,9s/^# \{0,1\}//p' "$0"; exit 2 ;;
esac

# The programs that a build says it has made, without what only a debugger reads.
collect() {
    "$@" --no-run 2>&1 | tee /dev/stderr | sed -n 's/^ *Executable.*(\(.*\))$/\1/p' | while read -r made; do
        name=$(basename "$made")
        strip --strip-all -o "$folder/${name%-*}" "$made" || exit 1
    done
}

if [ "$mode" = --build ]; then
    mkdir -p "$folder" || exit 1
    collect "${build[@]}" $(printf -- '--test %s ' "${tests[@]}") && collect "${bench[@]}" || exit 1
    # The tests of the programs start them where cargo puts them.
    target=$(cargo metadata --no-deps --format-version 1 --locked | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
    for program in ltm ltm-pack ltm-unpack; do
        strip --strip-all -o "$folder/$program" "$target/debug/$program" || exit 1
    done
    printf '%s\n' "$target" > "$folder/target"
    exit 0
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
rows=""
failed=0

# Runs a test, which is named last, by the command before it, if there is one; five minutes at most where it is built already. Adds a
# row: what, passed, failed, ignored.
tested() {
    local what=$1 result command
    shift
    if [ "$mode" = --run ]; then command=(timeout 300 "${@:1:$#-1}" "$folder/${!#}"); else command=("${@:1:$#-1}" "${build[@]}" --test "${!#}"); fi
    printf '\n== %s: %s\n' "$what" "${command[*]}"
    if "${command[@]}" 2>&1 | tee "$work/log"; then result=""; else result=" (failed)" failed=1; fi
    rows+=$(awk -v what="$what$result" '/^test result:/ { passed += $4; failed += $6; ignored += $8 }
        END { printf "| %s | %d | %d | %d |", what, passed, failed, ignored }' "$work/log")$'\n'
}

if [ "$mode" = --run ]; then
    target=$(cat "$folder/target") || exit 1
    mkdir -p "$target/debug" "$target/tmp" && cp "$folder"/ltm "$folder"/ltm-pack "$folder"/ltm-unpack "$target/debug" || exit 1
    bench=("$folder/gpu")
fi
display=()
if command -v xvfb-run >/dev/null && [ -z "${DISPLAY:-}" ]; then display=(xvfb-run -a); fi
tested "relight, paging, parity" relight_gpu
tested "programs" gpu_cli
tested "mixer and looks" "${display[@]}" view
tested "window" "${display[@]}" view_window

printf '\n== rates\n'
"${bench[@]}" 2>&1 | tee "$work/rates" || failed=1

printf '\n== the table (%s)\n\n| tests | passed | failed | ignored |\n|---|---|---|---|\n%s' "$(git describe --always --dirty 2>/dev/null)" "$rows"
sed -n '/^Adapter: /,$p' "$work/rates"
exit "$failed"
