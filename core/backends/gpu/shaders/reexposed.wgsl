// A photo's values through a curve; where the file may have clipped them no farther from the render than that allows
// (`core.training.exposures`).
// uses: items
struct Params {
    whole: vec4u, // values, values of a plane, levels of the curve
    white: vec4u, // by plane: the first level that may be clipped; the first that is not clipped to black
    black: vec4u,
    most: vec4f,  // what may be clipped to black is at most
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> photo: array<f32>;
@group(0) @binding(2) var<storage, read> shown: array<f32>;
@group(0) @binding(3) var<storage, read> table: array<f32>;
@group(0) @binding(4) var<storage, read_write> asked: array<f32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = item(group, groups, thread, GROUP);
    if (i >= params.whole.x) {
        return;
    }
    let plane = i / params.whole.y;
    let level = u32(round(clamp(photo[i], 0.0, 1.0) * f32(params.whole.z - 1u)));
    var value = table[plane * params.whole.z + level];
    if (level >= params.white[plane]) {
        value = max(value, shown[i]);
    }
    if (level < params.black[plane]) {
        value = min(max(value, shown[i]), params.most[plane]);
    }
    asked[i] = value;
}
