// What all kernels share: the structs of their arrays, and the size of a workgroup. Stands in front of each of them.

const THREADS: u32 = 64u;

// Bits of Component.narrow.
const NARROW_RIGHT: u32 = 1u;
const NARROW_LEFT: u32 = 2u;

// Numbers of things in a bank of blocks.
struct Sizes {
    columns: u32,
    components: u32,
    blocks: u32,
    sparse_rows: u32,
}

struct Component {
    right_word: u32,
    left_word: u32,
    // Which factors are in 8 bits; else 16-bit floats. Both where the scale is 0 and nothing stands at the words: whatever
    // is read there in 8 bits is finite.
    narrow: u32,
    scale: f32,
}

struct Block {
    first_component: u32,
    component_count: u32,
    pixels: u32,
    // First pixel of the block in `image`, whose pixels stand block after block.
    first_pixel: u32,
    // Number of the block in the picture's grid.
    id: u32,
}

struct SparseRow {
    // Place in `image`: three times the pixel, plus the channel.
    target_index: u32,
    first: u32,
    end: u32,
}

struct SparseEntry {
    column: u32,
    value: f32,
}

struct Tone {
    // What each channel is multiplied by: exposure and white balance.
    gain: vec3<f32>,
    // 0 none, 1 AgX, 2 filmic, 3 neutral, 4 false colour.
    curve: u32,
    // Width of the picture and side of its blocks, in pixels.
    width: u32,
    side: u32,
    // Where false colours begin, and over how much they go, in stops.
    low_stops: f32,
    range_stops: f32,
}
