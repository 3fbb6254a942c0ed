// Sums, lengths or largest values along one axis, a thread for each result, always in the same order.
// uses: items
struct Params {
    sizes: vec4u, // of the result's axes, and the steps in the source
    steps: vec4u,
    offset: u32,
    length: u32, // of the axis that goes, and its step
    step: u32,
    count: u32,
    operation: u32,
    factor: f32,
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
    let s = params.sizes;
    let last = i / s.w;
    let third = last / s.z;
    let at = vec4u(third / s.y, third % s.y, last % s.z, i % s.w) * params.steps;
    let first = params.offset + at.x + at.y + at.z + at.w;
    var total = select(0.0, source[first], params.operation == LARGER);
    for (var k = 0u; k < params.length; k++) {
        let value = source[first + k * params.step];
        if (params.operation == LARGER) {
            total = max(total, value);
        } else if (params.operation == ROOT) {
            total += value * value;
        } else {
            total += value;
        }
    }
    out[i] = params.factor * select(total, sqrt(total), params.operation == ROOT);
}
