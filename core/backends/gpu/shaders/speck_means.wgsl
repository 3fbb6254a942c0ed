// The binomial mean taken back.
// uses: binomial
@group(0) @binding(2) var<storage, read_write> means: array<f32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = item(group, groups, thread, GROUP);
    let plane = params.width * params.height;
    if (i >= plane) {
        return;
    }
    let mean = mean_at(i);
    means[i] = mean.x;
    means[plane + i] = mean.y;
    means[2u * plane + i] = mean.z;
}
