// From linear radiance to 8 bits of sRGB; twin of src/image/tone.rs.
// One thread for each pixel, which is packed as red, green, blue and 255 from the lowest byte up.

@group(0) @binding(0) var<uniform> tone_mapping: Tone;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read_write> shown: array<u32>;

fn encode_srgb(linear: vec3<f32>) -> vec3<f32> {
    let v = clamp(linear, vec3<f32>(0.0), vec3<f32>(1.0));
    let curved = 1.055 * pow(v, vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(curved, 12.92 * v, v <= vec3<f32>(0.0031308));
}

fn agx(linear: vec3<f32>) -> vec3<f32> {
    let into_base = transpose(mat3x3<f32>(
        0.84247905, 0.0784336, 0.079223745,
        0.042328242, 0.87846864, 0.07916613,
        0.042375655, 0.0784336, 0.879143));
    let out_of_base = transpose(mat3x3<f32>(
        1.196879, -0.09802088, -0.09902974,
        -0.052896757, 1.1519031, -0.09896118,
        -0.052971636, -0.09804345, 1.1510737));
    let low = -12.47393;
    let high = 4.026069;
    let stops = log2(max(into_base * linear, vec3<f32>(1e-10)));
    let x = (clamp(stops, vec3<f32>(low), vec3<f32>(high)) - low) / (high - low);
    let curved = ((((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x) - 0.00232;
    return clamp(out_of_base * curved, vec3<f32>(0.0), vec3<f32>(1.0));
}

fn neutral(linear: vec3<f32>) -> vec3<f32> {
    let start = 0.76;
    let least = min(linear.x, min(linear.y, linear.z));
    let offset = select(0.04, least - 6.25 * least * least, least < 0.08);
    let color = linear - offset;
    let peak = max(color.x, max(color.y, color.z));
    if peak < start {
        return color;
    }
    let room = 1.0 - start;
    let new_peak = 1.0 - room * room / (peak + room - start);
    let mixed = 1.0 - 1.0 / (0.15 * (peak - new_peak) + 1.0);
    return color * (new_peak / peak) * (1.0 - mixed) + vec3<f32>(new_peak * mixed);
}

@compute @workgroup_size(THREADS)
fn tone(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = (group.x + group.y * groups.x) * THREADS + thread;
    if pixel >= arrayLength(&shown) {
        return;
    }
    let radiance = vec3<f32>(image[3u * pixel], image[3u * pixel + 1u], image[3u * pixel + 2u]);
    let linear = max(radiance * tone_mapping.gain, vec3<f32>(0.0));
    var display: vec3<f32>;
    switch tone_mapping.curve {
        case 1u: {
            display = agx(linear);
        }
        case 2u: {
            display = encode_srgb((linear * (2.51 * linear + 0.03)) / (linear * (2.43 * linear + 0.59) + 0.14));
        }
        case 3u: {
            display = encode_srgb(neutral(linear));
        }
        default: {
            display = encode_srgb(linear);
        }
    }
    let bytes = vec3<u32>(display * 255.0 + 0.5);
    shown[pixel] = bytes.x | bytes.y << 8u | bytes.z << 16u | 255u << 24u;
}
