// Windows along columns of x, y, x^2, y^2 and x y, into fields[5][3][height][width].
// uses: window
@group(0) @binding(1) var<storage, read> filled: array<vec2f>;
@group(0) @binding(2) var<storage, read_write> fields: array<f32>;

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
    var sums: array<f32, 5>;
    for (var t = -WINDOW_REACH; t <= WINDOW_REACH; t++) {
        if (row + t >= 0 && row + t < i32(params.height)) {
            let source = u32(i32(i) + t * i32(params.width));
            let x = filled[source].x;
            let y = filled[source].y;
            let k = tap(t);
            sums[0] += k * x;
            sums[1] += k * y;
            sums[2] += k * (x * x);
            sums[3] += k * (y * y);
            sums[4] += k * (x * y);
        }
    }
    for (var field = 0u; field < 5u; field++) {
        fields[field * params.count + i] = sums[field];
    }
}
