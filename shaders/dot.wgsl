// What the kernels named project share: their arrays, the part of four components' dot products that one thread of their
// workgroup adds up, and where the sums go. Four at once, so that what is read of the lighting serves all of them.

@group(0) @binding(0) var<uniform> sizes: Sizes;
// A plane for each channel, in fours.
@group(0) @binding(1) var<storage, read> lighting: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> components: array<Component>;
@group(0) @binding(4) var<storage, read_write> projected: array<f32>;

// Components of one workgroup: a mat4x3 holds their sums.
const TOGETHER: u32 = 4u;

// A component; one that adds nothing where there is none.
fn component_at(index: u32) -> Component {
    if index < sizes.components {
        return components[index];
    }
    return Component(0u, 0u, NARROW_RIGHT | NARROW_LEFT, 0.0);
}

fn is_right_narrow(component: Component) -> bool {
    return (component.narrow & NARROW_RIGHT) != 0u;
}

fn right_words(component: Component, quad: u32) -> vec2<u32> {
    return words(component.right_word, quad, is_right_narrow(component));
}

fn partial_products(first: u32, thread: u32) -> mat4x3<f32> {
    let a = component_at(first);
    let b = component_at(first + 1u);
    let c = component_at(first + 2u);
    let d = component_at(first + 3u);
    let quads = (sizes.columns + 3u) / 4u;
    var sums = mat4x3<f32>();
    for (var quad = thread; quad < quads; quad += THREADS) {
        let weights = mat3x4<f32>(lighting[quad], lighting[quads + quad], lighting[2u * quads + quad]);
        // All loads before the first branch.
        let of_a = right_words(a, quad);
        let of_b = right_words(b, quad);
        let of_c = right_words(c, quad);
        let of_d = right_words(d, quad);
        sums += mat4x3<f32>(
            values(of_a, is_right_narrow(a)) * weights,
            values(of_b, is_right_narrow(b)) * weights,
            values(of_c, is_right_narrow(c)) * weights,
            values(of_d, is_right_narrow(d)) * weights);
    }
    return sums;
}

fn store(first: u32, sums: mat4x3<f32>) {
    for (var i = 0u; i < min(TOGETHER, sizes.components - first); i++) {
        let total = sums[i] * components[first + i].scale;
        let at = 3u * (first + i);
        projected[at] = total.x;
        projected[at + 1u] = total.y;
        projected[at + 2u] = total.z;
    }
}
