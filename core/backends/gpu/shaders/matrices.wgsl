// Products of matrices [planes, rows, inner] and [planes, inner, columns], each at steps of its own.
// uses: items
struct Params { planes: u32, rows: u32, columns: u32, inner: u32, a_steps: vec4u, b_steps: vec4u } // behind: offsets
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
    if (i >= params.planes * params.rows * params.columns) {
        return;
    }
    let column = i % params.columns;
    let row = (i / params.columns) % params.rows;
    let plane = i / (params.columns * params.rows);
    let from_a = params.a_steps.w + plane * params.a_steps.x + row * params.a_steps.y;
    let from_b = params.b_steps.w + plane * params.b_steps.x + column * params.b_steps.z;
    var total = 0.0;
    for (var k = 0u; k < params.inner; k++) {
        total += a[from_a + k * params.a_steps.z] * b[from_b + k * params.b_steps.y];
    }
    out[i] = total;
}
