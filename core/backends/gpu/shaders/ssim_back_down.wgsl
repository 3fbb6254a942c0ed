// Windows along columns of the three derivatives.
// uses: window
@group(0) @binding(1) var<storage, read> derivatives: array<f32>;
@group(0) @binding(2) var<storage, read_write> windows: array<f32>;

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
    let row = i32((i / params.width) % params.height);
    var sums: array<f32, 3>;
    for (var t = -WINDOW_REACH; t <= WINDOW_REACH; t++) {
        if (row + t >= 0 && row + t < i32(params.height)) {
            for (var field = 0u; field < 3u; field++) {
                let source = i32(field * params.count + i) + t * i32(params.width);
                sums[field] += tap(t) * derivatives[u32(source)];
            }
        }
    }
    for (var field = 0u; field < 3u; field++) {
        windows[field * params.count + i] = sums[field];
    }
}
