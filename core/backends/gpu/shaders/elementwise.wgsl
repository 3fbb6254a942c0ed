// scale a + shift, a b, or a + scale b, value by value.
// uses: items
struct Params { count: u32, operation: u32, scale: f32, shift: f32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> a: array<f32>;
@group(0) @binding(2) var<storage, read> b: array<f32>;
@group(0) @binding(3) var<storage, read_write> out: array<f32>;

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
    if (params.operation == SCALED) {
        out[i] = params.scale * a[i] + params.shift;
    } else if (params.operation == PRODUCT) {
        out[i] = a[i] * b[i];
    } else {
        out[i] = a[i] + params.scale * b[i];
    }
}
