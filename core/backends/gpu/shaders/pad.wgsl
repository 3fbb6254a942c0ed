// Planes grown or cut at their borders; beyond the border stands a number, or the border itself is repeated.
// uses: items
struct Params {
    width: u32, // of the result
    height: u32,
    count: u32,
    repeated: u32,
    columns: u32, // of the source
    rows: u32,
    left: i32,
    top: i32,
    beyond: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> source: array<f32>;
@group(0) @binding(2) var<storage, read_write> out: array<f32>;

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
    let last = vec2i(i32(params.columns), i32(params.rows)) - 1;
    let at = vec2i(i32(i % params.width) - params.left, i32((i / params.width) % params.height) - params.top);
    let nearest = clamp(at, vec2i(0), last);
    if (params.repeated == 0u && any(at != nearest)) {
        out[i] = params.beyond;
        return;
    }
    let plane = i / (params.width * params.height);
    out[i] = source[(plane * params.rows + u32(nearest.y)) * params.columns + u32(nearest.x)];
}
