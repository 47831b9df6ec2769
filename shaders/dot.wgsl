// What the kernels named project share: their arrays, the part of a component's dot products that one thread of its
// workgroup adds up, and where the sums go.

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read> lighting: array<f32>;
@group(0) @binding(2) var<storage, read> components: array<Component>;
@group(0) @binding(3) var<storage, read> factors: array<u32>;
@group(0) @binding(4) var<storage, read_write> projected: array<f32>;

fn weight(column: u32) -> vec3<f32> {
    let n = sizes.columns;
    return vec3<f32>(lighting[column], lighting[n + column], lighting[2u * n + column]);
}

fn signed_byte(word: u32, byte: u32) -> f32 {
    return f32(bitcast<i32>(word << (24u - 8u * byte)) >> 24u);
}

fn partial_product(index: u32, thread: u32) -> vec3<f32> {
    var sum = vec3<f32>(0.0);
    if index >= sizes.components {
        return sum;
    }
    let component = components[index];
    if component.scale == 0.0 {
        return sum;
    }
    let per_word = select(2u, 4u, (component.narrow & 1u) != 0u);
    let words = (sizes.columns + per_word - 1u) / per_word;
    for (var w = thread; w < words; w += THREADS) {
        let word = factors[component.right_word + w];
        let first = w * per_word;
        var values: vec4<f32>;
        if per_word == 4u {
            values = vec4<f32>(
                signed_byte(word, 0u), signed_byte(word, 1u), signed_byte(word, 2u), signed_byte(word, 3u));
        } else {
            values = vec4<f32>(unpack2x16float(word), 0.0, 0.0);
        }
        for (var i = 0u; i < min(per_word, sizes.columns - first); i++) {
            sum += values[i] * weight(first + i);
        }
    }
    return sum;
}

fn store(index: u32, sum: vec3<f32>) {
    let total = sum * components[index].scale;
    projected[3u * index] = total.x;
    projected[3u * index + 1u] = total.y;
    projected[3u * index + 2u] = total.z;
}
