// c = L y; twin of src/relight/reconstruct.rs.
// One thread for four neighbouring pixels of a block, all channels: planes of L are padded to whole words.

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read> blocks: array<Block>;
@group(0) @binding(2) var<storage, read> components: array<Component>;
@group(0) @binding(4) var<storage, read> projected: array<f32>;
@group(0) @binding(5) var<storage, read_write> image: array<f32>;

// Pixels of one workgroup, whose threads write them side by side.
const PIXELS: u32 = 4u * THREADS;
var<workgroup> radiance: array<f32, 3u * PIXELS>;

struct Planes {
    red: vec2<u32>,
    green: vec2<u32>,
    blue: vec2<u32>,
}

fn is_left_narrow(component: Component) -> bool {
    return component.is_narrow != 0u;
}

// The words of four pixels: `quads` is the number of fours in a plane.
fn left_words(component: Component, quads: u32, quad: u32) -> Planes {
    let is_narrow = is_left_narrow(component);
    return Planes(
        words(component.left_word, quad, is_narrow),
        words(component.left_word, quads + quad, is_narrow),
        words(component.left_word, 2u * quads + quad, is_narrow));
}

fn product(planes: Planes, is_narrow: bool, y: vec3<f32>) -> mat3x4<f32> {
    return mat3x4<f32>(
        values(planes.red, is_narrow) * y.x, values(planes.green, is_narrow) * y.y, values(planes.blue, is_narrow) * y.z);
}

fn projected_at(k: u32) -> vec3<f32> {
    return vec3<f32>(projected[3u * k], projected[3u * k + 1u], projected[3u * k + 2u]);
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
    let start = group.x * PIXELS;
    if start >= block.pixels {
        return;
    }
    let quads = (block.pixels + 3u) / 4u;
    // Threads behind the last pixel repeat it.
    let quad = min(start / 4u + thread, quads - 1u);
    let end = block.first_component + block.component_count;
    var sum = mat3x4<f32>();
    for (var k = block.first_component; k < end; k += 2u) {
        // Two at once, so that their loads overlap; a last one without another comes twice and counts once.
        let next = min(k + 1u, end - 1u);
        let a = components[k];
        let b = components[next];
        let of_a = left_words(a, quads, quad);
        let of_b = left_words(b, quads, quad);
        let y = projected_at(k);
        let z = select(vec3<f32>(0.0), projected_at(next), k + 1u < end);
        sum += product(of_a, is_left_narrow(a), y);
        sum += product(of_b, is_left_narrow(b), z);
    }
    for (var i = 0u; i < 4u; i++) {
        for (var channel = 0u; channel < 3u; channel++) {
            radiance[12u * thread + 3u * i + channel] = sum[channel][i];
        }
    }
    workgroupBarrier();
    let count = 3u * min(PIXELS, block.pixels - start);
    for (var i = thread; i < count; i += THREADS) {
        image[3u * (block.first_pixel + start) + i] = radiance[i];
    }
}
