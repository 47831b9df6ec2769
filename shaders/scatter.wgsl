// c += S l; twin of src/relight/scatter.rs.
// One thread for each row that has sparse entries, so that no two write to the same place.

@group(0) @binding(0) var<uniform> sizes: Sizes;
// A plane for each channel, in fours: first of coefficients, then of columns.
@group(0) @binding(1) var<storage, read> lighting: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> rows: array<SparseRow>;
@group(0) @binding(3) var<storage, read> entries: array<SparseEntry>;
@group(0) @binding(4) var<storage, read_write> image: array<f32>;

@compute @workgroup_size(THREADS)
fn scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = (group.x + group.y * groups.x) * THREADS + thread;
    if index >= sizes.sparse_rows {
        return;
    }
    let row = rows[index];
    let channel = row.target_index % 3u;
    let plane = 3u * (sizes.coefficients / 4u) + channel * ((sizes.columns + 3u) / 4u);
    var sum = 0.0;
    for (var i = row.first; i < row.end; i++) {
        let column = entries[i].column;
        sum += entries[i].value * lighting[plane + column / 4u][column % 4u];
    }
    image[row.target_index] += sum;
}
