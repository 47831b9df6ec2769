// c = L y; twin of src/relight/reconstruct.rs.
// One thread for four neighbouring pixels of a block, all channels: planes of L are padded to whole words.

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read> blocks: array<Block>;
@group(0) @binding(2) var<storage, read> components: array<Component>;
@group(0) @binding(3) var<storage, read> factors: array<u32>;
@group(0) @binding(4) var<storage, read> projected: array<f32>;
@group(0) @binding(5) var<storage, read_write> image: array<f32>;

fn signed_bytes(word: u32) -> vec4<f32> {
    let shifted = vec4<u32>(word << 24u, word << 16u, word << 8u, word);
    return vec4<f32>(bitcast<vec4<i32>>(shifted) >> vec4<u32>(24u));
}

// Four values of a plane of L: `quads` is the number of fours in a plane.
fn four(component: Component, channel: u32, quads: u32, quad: u32) -> vec4<f32> {
    let at = channel * quads + quad;
    if (component.narrow & 2u) != 0u {
        return signed_bytes(factors[component.left_word + at]);
    }
    let word = component.left_word + 2u * at;
    return vec4<f32>(unpack2x16float(factors[word]), unpack2x16float(factors[word + 1u]));
}

@compute @workgroup_size(THREADS)
fn reconstruct(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = group.y + group.z * groups.y;
    if index >= sizes.blocks {
        return;
    }
    let block = blocks[index];
    let quads = (block.pixels + 3u) / 4u;
    let quad = group.x * THREADS + thread;
    if quad >= quads {
        return;
    }
    var red = vec4<f32>(0.0);
    var green = vec4<f32>(0.0);
    var blue = vec4<f32>(0.0);
    for (var k = 0u; k < block.component_count; k++) {
        let component = components[block.first_component + k];
        if component.scale != 0.0 {
            let y = 3u * (block.first_component + k);
            red += four(component, 0u, quads, quad) * projected[y];
            green += four(component, 1u, quads, quad) * projected[y + 1u];
            blue += four(component, 2u, quads, quad) * projected[y + 2u];
        }
    }
    for (var i = 0u; i < min(4u, block.pixels - 4u * quad); i++) {
        let at = 3u * (block.first_pixel + 4u * quad + i);
        image[at] = red[i];
        image[at + 1u] = green[i];
        image[at + 2u] = blue[i];
    }
}
