// y = s (R l) for the three channels; twin of src/relight/project.rs (the products: right.rs).
// One workgroup for each component: its threads share the cells and add up in workgroup memory.

var<workgroup> sums: array<vec3<f32>, THREADS>;

@compute @workgroup_size(THREADS)
fn project(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let component = group.x + group.y * groups.x;
    // Threads of a workgroup behind the last component add up nothing.
    if component < sizes.components {
        sums[thread] = partial_product(components[component], thread);
    }
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if thread < half {
            sums[thread] += sums[thread + half];
        }
    }
    if thread == 0u && component < sizes.components {
        store(component, sums[0]);
    }
}
