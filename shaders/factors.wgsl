// The factors of a bank's components, as the kernels project and reconstruct read them.

@group(0) @binding(3) var<storage, read> factors: array<u32>;

// The words of the four values of a left side at `quad` of those that begin with a word: one in 8 bits, two in 16. The one is read twice:
// loads without branches overlap.
fn words(first: u32, quad: u32, is_narrow: bool) -> vec2<u32> {
    let wide = select(1u, 0u, is_narrow);
    let at = first + (quad << wide);
    return vec2<u32>(factors[at], factors[at + wide]);
}

// Bytes through the mantissa of 2^23, where additions are exact, in place of conversions.
fn signed_bytes(word: u32) -> vec4<f32> {
    let biased = word ^ 0x80808080u;
    let bytes = vec4<u32>(biased, biased >> 8u, biased >> 16u, biased >> 24u) & vec4<u32>(0xffu);
    return bitcast<vec4<f32>>(bytes | vec4<u32>(0x4b000000u)) - (8388608.0 + 128.0);
}

fn values(pair: vec2<u32>, is_narrow: bool) -> vec4<f32> {
    if is_narrow {
        return signed_bytes(pair.x);
    }
    return vec4<f32>(unpack2x16float(pair.x), unpack2x16float(pair.y));
}
