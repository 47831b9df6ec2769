// What all kernels share: the structs of their arrays, and the size of a workgroup. Stands in front of each of them.

const THREADS: u32 = 64u;

// Numbers of things in a bank of blocks.
struct Sizes {
    columns: u32,
    // Coefficients of a plane of the lighting, a multiple of four.
    coefficients: u32,
    components: u32,
    blocks: u32,
    sparse_rows: u32,
}

struct Component {
    // Its cells: what its right side has in each tile of the transform, in one or more parts that add up.
    first_cell: u32,
    cells: u32,
    left_word: u32,
    // Whether the left side is in 8 bits; else 16-bit floats. Also where nothing stands at the word: whatever is read there in
    // 8 bits is finite.
    is_narrow: u32,
}

struct Cell {
    // Where it begins among the factors: dense numbers, a byte each, then entries, two bytes each.
    word: u32,
    // Groups of sixteen dense numbers, and above the lowest 16 bits entries.
    lengths: u32,
    // Where its tile begins in a plane of the lighting, a multiple of four.
    first: u32,
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
