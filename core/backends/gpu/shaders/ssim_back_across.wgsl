// Windows along rows, and the gradient of the loss.
// uses: window
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> photo: array<f32>;
@group(0) @binding(3) var<storage, read> windows: array<f32>;
@group(0) @binding(4) var<storage, read_write> gradient: array<f32>;

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
    let structure = w.x + 2.0 * image[i] * w.y + photo[i] * w.z;
    gradient[i] = params.error_weight * sign(image[i] - photo[i]) - params.structure_weight * structure;
}
