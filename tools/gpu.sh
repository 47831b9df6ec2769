#!/usr/bin/env bash
# All that wants a GPU, on a machine that has one: relighting, paging and parity with the CPU, the window, and then the rates of the
# GPU's memory and bus with those of relighting beside them. Prints one table; exit code 1 if a test fails. An adapter in software runs
# it all too, and is called software. LTM_GPU_PROFILE names cargo's profile: bench, or dev where only the tests matter.
set -uo pipefail
cd "$(dirname "$0")/.."
export LTM_REQUIRE_GPU=1

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
rows=""
failed=0

# Runs a command and adds a row: what, passed, failed, ignored.
tested() {
    local what=$1 result
    shift
    printf '\n== %s: %s\n' "$what" "$*"
    if "$@" 2>&1 | tee "$work/log"; then result=""; else result=" (failed)" failed=1; fi
    rows+=$(awk -v what="$what$result" '/^test result:/ { passed += $4; failed += $6; ignored += $8 }
        END { printf "| %s | %d | %d | %d |", what, passed, failed, ignored }' "$work/log")$'\n'
}

# One set of features for all, so that nothing is built twice.
tested "relight, paging, parity" cargo test --workspace --locked --test relight_gpu
tested "programs" cargo test --workspace --locked --test gpu_cli
if command -v xvfb-run >/dev/null && [ -z "${DISPLAY:-}" ]; then
    tested "window" xvfb-run -a cargo test --workspace --locked --test view --test view_window
else
    tested "window" cargo test --workspace --locked --test view --test view_window
fi

printf '\n== rates\n'
cargo bench --workspace --locked --profile "${LTM_GPU_PROFILE:-bench}" --bench gpu 2>&1 | tee "$work/rates" || failed=1

printf '\n== the table (%s)\n\n| tests | passed | failed | ignored |\n|---|---|---|---|\n%s' "$(git describe --always --dirty 2>/dev/null)" "$rows"
sed -n '/^Adapter: /,$p' "$work/rates"
exit "$failed"
