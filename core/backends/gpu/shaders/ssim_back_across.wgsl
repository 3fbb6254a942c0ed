// Windows along rows, and the gradient of the loss.
// uses: window
@group(0) @binding(1) var<storage, read> filled: array<vec2f>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read> windows: array<f32>;
@group(0) @binding(4) var<storage, read> totals: array<vec2f>; // the first: how many values count
@group(0) @binding(5) var<storage, read_write> gradient: array<f32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = item(group, groups, thread, GROUP);
    if (i >= params.count) {
        return;
    }
    let column = i32(i % params.width);
    var w = vec3f(0.0);
    for (var t = -WINDOW_REACH; t <= WINDOW_REACH; t++) {
        if (column + t >= 0 && column + t < i32(params.width)) {
            let source = u32(i32(i) + t);
            w += tap(t) * vec3f(windows[source], windows[params.count + source], windows[2u * params.count + source]);
        }
    }
    let x = filled[i].x;
    let y = filled[i].y;
    let structure = w.x + 2.0 * x * w.y + y * w.z;
    let slope = params.error_weight * sign(x - y) - params.structure_weight * structure;
    gradient[i] = weights[i] * slope / max(totals[0].x, 1.0);
}
