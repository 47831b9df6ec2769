// What the kernels named project share: their arrays, and the part of a component's dot product that one thread of its workgroup
// adds up.

@group(0) @binding(0) var<uniform> sizes: Sizes;
// A plane for each channel, in fours: first of coefficients, then of columns.
@group(0) @binding(1) var<storage, read> lighting: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> components: array<Component>;
@group(0) @binding(4) var<storage, read_write> projected: array<f32>;
@group(0) @binding(5) var<storage, read> cells: array<Cell>;

// Threads that share a cell: a workgroup has four at once.
const SHARING: u32 = 16u;

// Bits of an entry that are its place in the tile; the six above them are its number.
const PLACE_BITS: u32 = 10u;

fn entry_product(first: u32, entry: u32) -> vec3<f32> {
    let place = first + extractBits(entry, 0u, PLACE_BITS);
    let number = f32(extractBits(bitcast<i32>(entry), PLACE_BITS, 6u));
    let quad = place / 4u;
    let quads = sizes.coefficients / 4u;
    let weights = mat3x4<f32>(lighting[quad], lighting[quads + quad], lighting[2u * quads + quad]);
    let lane = place % 4u;
    return number * vec3<f32>(weights[0][lane], weights[1][lane], weights[2][lane]);
}

fn partial_product(component: Component, thread: u32) -> vec3<f32> {
    let quads = sizes.coefficients / 4u;
    var total = vec3<f32>();
    for (var i = thread / SHARING; i < component.cells; i += THREADS / SHARING) {
        let cell = cells[component.first_cell + i];
        let dense = 4u * (cell.lengths & 0xffffu);
        let pairs = ((cell.lengths >> 16u) + 1u) / 2u;
        var sum = vec3<f32>();
        for (var word = thread % SHARING; word < dense; word += SHARING) {
            let quad = cell.first / 4u + word;
            let weights = mat3x4<f32>(lighting[quad], lighting[quads + quad], lighting[2u * quads + quad]);
            sum += signed_bytes(factors[cell.word + word]) * weights;
        }
        // An odd number of entries is filled up with one of number 0.
        for (var pair = thread % SHARING; pair < pairs; pair += SHARING) {
            let word = factors[cell.word + dense + pair];
            sum += entry_product(cell.first, word & 0xffffu) + entry_product(cell.first, word >> 16u);
        }
        total += cell.scale * sum;
    }
    return total;
}

fn store(component: u32, sum: vec3<f32>) {
    projected[3u * component] = sum.x;
    projected[3u * component + 1u] = sum.y;
    projected[3u * component + 2u] = sum.z;
}
