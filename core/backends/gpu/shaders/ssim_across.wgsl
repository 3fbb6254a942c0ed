// Windows along rows, SSIM and its derivatives by the windowed means of x, x^2 and x y; each group's sums of SSIM and
// of |x - y|, of the values that count.
// uses: window
@group(0) @binding(1) var<storage, read> filled: array<vec2f>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read> fields: array<f32>;
@group(0) @binding(4) var<storage, read_write> derivatives: array<f32>;
@group(0) @binding(5) var<storage, read_write> sums: array<vec2f>;

var<workgroup> own: array<vec2f, GROUP>;

fn similarity(i: u32) -> vec2f {
    let column = i32(i % params.width);
    var w: array<f32, 5>;
    for (var t = -WINDOW_REACH; t <= WINDOW_REACH; t++) {
        if (column + t >= 0 && column + t < i32(params.width)) {
            for (var field = 0u; field < 5u; field++) {
                w[field] += tap(t) * fields[u32(i32(field * params.count + i) + t)];
            }
        }
    }
    let m = w[0];
    let n = w[1];
    let variance = max(w[2] - m * m, 0.0);
    let other_variance = max(w[3] - n * n, 0.0);
    // Rounding must not push the correlation of flat windows beyond 1 or -1.
    let highest = 0.5 * (variance + other_variance);
    let covariance = clamp(w[4] - m * n, -highest, highest);
    let top_mean = 2.0 * m * n + SSIM_C1;
    let top_variance = 2.0 * covariance + SSIM_C2;
    let below_mean = m * m + n * n + SSIM_C1;
    let below_variance = variance + other_variance + SSIM_C2;
    let inverse = 1.0 / (below_mean * below_variance);
    let value = top_mean * top_variance * inverse;
    let weight = weights[i];
    let by_mean = value * below_variance * inverse;
    let by_variance = value * below_mean * inverse;
    derivatives[i] = weight * 2.0 * (n * (top_variance - top_mean) * inverse + m * (by_variance - by_mean));
    derivatives[params.count + i] = -weight * by_variance;
    derivatives[2u * params.count + i] = weight * 2.0 * top_mean * inverse;
    return weight * vec2f(value, abs(filled[i].x - filled[i].y));
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = item(group, groups, thread, GROUP);
    own[thread] = vec2f(0.0);
    if (i < params.count) {
        own[thread] = similarity(i);
    }
    workgroupBarrier();
    let block = group.y * groups.x + group.x;
    if (thread == 0u && block * GROUP < params.count) {
        var sum = vec2f(0.0);
        for (var t = 0u; t < GROUP; t++) {
            sum += own[t];
        }
        sums[block] = sum;
    }
}
