// Products of complex numbers; CONJUGATED: with the second one's conjugate.
// uses: operands
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

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
    let to = place(i, params.out_steps, params.offsets.w);
    var x: vec2f;
    if ((params.flags & IN_PLACE) != 0u) {
        x = vec2f(out[to], out[to + 1u]);
    } else {
        let at = place(i, params.a_steps, params.offsets.x);
        x = vec2f(bitcast<f32>(a[at]), bitcast<f32>(a[at + 1u]));
    }
    let from_b = place(i, params.b_steps, params.offsets.y);
    var y = vec2f(bitcast<f32>(b[from_b]), bitcast<f32>(b[from_b + 1u]));
    if ((params.flags & CONJUGATED) != 0u) {
        y.y = -y.y;
    }
    out[to] = x.x * y.x - x.y * y.y;
    out[to + 1u] = x.x * y.y + x.y * y.x;
}
