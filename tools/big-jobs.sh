#!/usr/bin/env bash
# The jobs larger than memory, end to end: the Conference Room under a panel of 32 × 32 texels (9 GiB as f32) and of
# 64 × 64 (36 GiB), rendered, verified, packed, unpacked and rendered straight into a container, each within 1 GiB.
# Prints seconds, bytes, GB/s and peak resident anonymous memory of each stage, and removes what it made.
#
#   tools/big-jobs.sh [WIDTHxHEIGHT] [SAMPLES] [SCENE…]      default: 1024x768 2 conference-panel-32 conference-panel-64
#
# LTM_SCENES names the folder of scenes; LTM_BIG the folder to work in (twice the largest matrix must fit, default: the
# temporary folder); LTM_BIN the folder of the programs (default: target/release); LTM_MEMORY the budget (1GiB).
set -euo pipefail
here=$(cd "$(dirname "$0")/.." && pwd)
size=${1:-1024x768} samples=${2:-2}
shift $(($# > 2 ? 2 : $#))
[ $# -gt 0 ] || set -- conference-panel-32 conference-panel-64
bin=${LTM_BIN:-$here/target/release} memory=${LTM_MEMORY:-1GiB}
work=$(mktemp -d -p "${LTM_BIG:-${TMPDIR:-/tmp}}" ltm-big.XXXXXX)
trap 'rm -rf "$work"' EXIT

# Peak of RssAnon is sampled by the programs themselves; the kernel's own account of the whole process stands beside it.
stage() {
    local name=$1 file=$2 begun ended bytes
    shift 2
    begun=$(date +%s.%N)
    "$@" >"$work/out" 2>"$work/err" || { cat "$work/out" "$work/err" >&2; return 1; }
    ended=$(date +%s.%N)
    bytes=$(stat -c %s "$work/$file")
    awk -v n="$name" -v a="$begun" -v b="$ended" -v raw="$raw" -v bytes="$bytes" -v allocated="$(du -B1 "$work/$file" | cut -f1)" \
        -v peak="$(grep -oE 'peak memory [0-9.]+ [KMG]iB' "$work/out" | head -1 | cut -d' ' -f3-)" \
        'BEGIN { s = b - a; printf "%-22s %9.1f s %15.0f bytes %15.0f on disk %7.3f GB/s of f32, peak %s\n", n, s, bytes, allocated, raw / s / 1e9, peak == "" ? "not said" : peak }'
    sed 's/^/    /' "$work/err" | grep -E 'needs up to' || true
}

for scene in "$@"; do
    # One column for each texel, one for each of the other 23 lamps; a row for each pixel and channel.
    columns=$(("${scene##*-}" * "${scene##*-}" + 23))
    raw=$((${size%x*} * ${size#*x} * 3 * columns * 4))
    printf '\n%s, %s, %s samples per pixel: %d rows × %d columns, %d bytes as f32\n' \
        "$scene" "$size" "$samples" $((${size%x*} * ${size#*x} * 3)) "$columns" "$raw"
    render=("$bin/ltm" render "$here/formats/scenes/$scene.toml" --size "$size" --samples "$samples" --memory "$memory")
    stage render big.ltm "${render[@]}" -o "$work/big.ltm"
    stage verify big.ltm "$bin/ltm" verify "$work/big.ltm" --memory "$memory"
    stage pack big.ltc "$bin/ltm-pack" "$work/big.ltm" --memory "$memory"
    grep -E 'ratio' "$work/out" | sed 's/^/    /'
    rm "$work/big.ltm"
    stage unpack again.ltm "$bin/ltm-unpack" "$work/big.ltc" -o "$work/again.ltm" --memory "$memory"
    rm "$work/again.ltm"
    stage 'render --pack' fused.ltc "${render[@]}" --pack -o "$work/fused.ltc"
    cmp "$work/big.ltc" "$work/fused.ltc" && echo '    the same bytes as the stored way'
    rm "$work/big.ltc" "$work/fused.ltc"
done
