// Derivatives of sqrt(l2 + eps^2), l2 the smaller eigenvalue of the averaged structure tensor, by its three entries.
// uses: binomial
@group(0) @binding(2) var<storage, read_write> slants: array<f32>;

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
    let half = 0.5 * (mean.x - mean.y);
    let spread = sqrt(half * half + mean.z * mean.z + SMOOTH_SQUARED * SMOOTH_SQUARED);
    let low = 0.5 * (mean.x + mean.y) - spread;
    var scale = 0.0;
    if (low > 0.0) {
        scale = 0.5 / sqrt(low + SMOOTH_SQUARED);
    }
    let turn = 0.5 * half / spread;
    slants[i] = scale * (0.5 - turn);
    slants[plane + i] = scale * (0.5 + turn);
    slants[2u * plane + i] = -scale * mean.z / spread;
}
