// y = s (R l) for the three channels in one pass over R; twin of src/relight/project.rs.
// One workgroup for each component: its threads share the columns and add up in workgroup memory.

struct Sizes {
    columns: u32,
    components: u32,
    blocks: u32,
    sparse_rows: u32,
}

struct Component {
    right_word: u32,
    left_word: u32,
    // Bit 0: R in 8 bits, bit 1: L in 8 bits; else 16-bit floats.
    narrow: u32,
    scale: f32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read> lighting: array<f32>;
@group(0) @binding(2) var<storage, read> components: array<Component>;
@group(0) @binding(3) var<storage, read> factors: array<u32>;
@group(0) @binding(4) var<storage, read_write> projected: array<f32>;

const THREADS: u32 = 64u;

var<workgroup> sums: array<vec3<f32>, THREADS>;

fn weight(column: u32) -> vec3<f32> {
    let n = sizes.columns;
    return vec3<f32>(lighting[column], lighting[n + column], lighting[2u * n + column]);
}

fn signed_byte(word: u32, byte: u32) -> f32 {
    return f32(bitcast<i32>(word << (24u - 8u * byte)) >> 24u);
}

@compute @workgroup_size(THREADS)
fn project(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = group.x + group.y * groups.x;
    var sum = vec3<f32>(0.0);
    if index < sizes.components {
        let component = components[index];
        if component.scale != 0.0 {
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
        }
    }
    sums[thread] = sum;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if thread < half {
            sums[thread] += sums[thread + half];
        }
    }
    if thread == 0u && index < sizes.components {
        let total = sums[0] * components[index].scale;
        projected[3u * index] = total.x;
        projected[3u * index + 1u] = total.y;
        projected[3u * index + 2u] = total.z;
    }
}
