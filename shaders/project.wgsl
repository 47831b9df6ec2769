// y = s (R l) for the three channels in one pass over R; twin of src/relight/project.rs.
// One workgroup for four components: its threads share the columns and add up in workgroup memory.

var<workgroup> sums: array<mat4x3<f32>, THREADS>;

@compute @workgroup_size(THREADS)
fn project(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let first = TOGETHER * (group.x + group.y * groups.x);
    sums[thread] = partial_products(first, thread);
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if thread < half {
            sums[thread] += sums[thread + half];
        }
    }
    if thread == 0u && first < sizes.components {
        store(first, sums[0]);
    }
}
