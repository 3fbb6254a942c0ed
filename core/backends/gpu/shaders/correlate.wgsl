// Every tap of a kernel: out[y, x] = sum taps[j, i] source[y + j - top, x + i - left]; beyond the source its edge is
// repeated, or there is nothing.
// uses: items
struct Params {
    width: u32,
    height: u32,
    count: u32,
    repeated: u32,
    columns: u32, // of the source
    rows: u32,
    left: i32,
    top: i32,
    across: i32, // taps
    down: i32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> taps: array<f32>;
@group(0) @binding(2) var<storage, read> source: array<f32>;
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
    let last = vec2i(i32(params.columns), i32(params.rows)) - 1;
    let plane = (i / (params.width * params.height)) * params.rows * params.columns;
    let first = vec2i(i32(i % params.width) - params.left, i32((i / params.width) % params.height) - params.top);
    var sum = 0.0;
    for (var y = 0; y < params.down; y++) {
        for (var x = 0; x < params.across; x++) {
            let at = first + vec2i(x, y);
            let nearest = clamp(at, vec2i(0), last);
            if (params.repeated == 1u || all(at == nearest)) {
                sum += taps[y * params.across + x] * source[plane + u32(nearest.y) * params.columns + u32(nearest.x)];
            }
        }
    }
    out[i] = sum;
}
