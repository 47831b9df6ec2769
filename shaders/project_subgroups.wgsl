// y = s (R l), as shaders/project.wgsl, where threads add up within their subgroups first; twin of src/relight/project.rs.

// One sum for each subgroup: a subgroup may be as small as one thread.
var<workgroup> sums: array<mat4x3<f32>, THREADS>;

@compute @workgroup_size(THREADS)
fn project(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
    @builtin(subgroup_invocation_id) lane: u32,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(num_subgroups) subgroups: u32,
) {
    let first = TOGETHER * (group.x + group.y * groups.x);
    let parts = partial_products(first, thread);
    let sum = mat4x3<f32>(
        subgroupAdd(parts[0]), subgroupAdd(parts[1]), subgroupAdd(parts[2]), subgroupAdd(parts[3]));
    if lane == 0u {
        sums[subgroup] = sum;
    }
    workgroupBarrier();
    if thread == 0u && first < sizes.components {
        var total = mat4x3<f32>();
        for (var i = 0u; i < subgroups; i++) {
            total += sums[i];
        }
        store(first, total);
    }
}
