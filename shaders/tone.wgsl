// From linear radiance to 8 bits of sRGB, or to false colours; twin of src/image/tone.rs.
// One thread for each pixel of a block.

@group(0) @binding(0) var<uniform> tone_mapping: Tone;
@group(0) @binding(1) var<storage, read> blocks: array<Block>;
@group(0) @binding(2) var<storage, read> image: array<f32>;
@group(0) @binding(3) var screen: texture_storage_2d<rgba8unorm, write>;

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

// From black over blue, green and red to white, sRGB-encoded.
fn false_colour(radiance: vec3<f32>) -> vec3<f32> {
    var colours = array<vec3<f32>, 7>(
        vec3<f32>(0.0, 0.0, 0.0),
        vec3<f32>(0.05, 0.0, 0.5),
        vec3<f32>(0.0, 0.4, 0.9),
        vec3<f32>(0.0, 0.7, 0.2),
        vec3<f32>(0.9, 0.8, 0.0),
        vec3<f32>(0.9, 0.1, 0.0),
        vec3<f32>(1.0, 1.0, 1.0));
    let luminance = dot(radiance, vec3<f32>(0.2126, 0.7152, 0.0722));
    let stops = log2(max(luminance, exp2(tone_mapping.low_stops))) - tone_mapping.low_stops;
    let at = clamp(stops / tone_mapping.range_stops, 0.0, 1.0) * 6.0;
    let step = min(u32(at), 5u);
    return encode_srgb(mix(colours[step], colours[step + 1u], at - f32(step)));
}

@compute @workgroup_size(THREADS)
fn tone(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = group.y + group.z * groups.y;
    if index >= arrayLength(&blocks) {
        return;
    }
    let block = blocks[index];
    let inside = group.x * THREADS + thread;
    if inside >= block.pixels {
        return;
    }
    let side = tone_mapping.side;
    let across = (tone_mapping.width + side - 1u) / side;
    let corner = side * vec2<u32>(block.id % across, block.id / across);
    let width = min(side, tone_mapping.width - corner.x);
    let pixel = block.first_pixel + inside;
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
        case 4u: {
            display = false_colour(radiance);
        }
        default: {
            display = encode_srgb(linear);
        }
    }
    textureStore(screen, corner + vec2<u32>(inside % width, inside / width), vec4<f32>(display, 1.0));
}
