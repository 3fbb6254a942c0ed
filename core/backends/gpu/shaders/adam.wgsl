// One step of Adam (Kingma and Ba 2015). A gradient whose square is not finite moves nothing, and is counted.
// uses: items, view
struct Params {
    count: u32,
    period: u32,  // values of each Gaussian
    leading: u32, // the first of them have a step size of their own
    begins: u32,  // where the gradient begins in its memory
    rate: f32,
    tail: f32,
    first_decay: f32,
    second_decay: f32,
    first_share: f32, // 1 - first_decay, rounded once
    second_share: f32,
    correction: f32,
    epsilon: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> gradient: array<f32>;
@group(0) @binding(2) var<storage, read_write> values: array<f32>;
@group(0) @binding(3) var<storage, read_write> first: array<f32>;
@group(0) @binding(4) var<storage, read_write> second: array<f32>;
@group(0) @binding(5) var<storage, read_write> refused: array<atomic<u32>>;

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
    var g = gradient[params.begins + i];
    if (!is_finite(g * g)) {
        g = 0.0;
        atomicAdd(&refused[0], 1u);
    }
    let m = params.first_decay * first[i] + params.first_share * g;
    let v = params.second_decay * second[i] + params.second_share * g * g;
    first[i] = m;
    second[i] = v;
    let rate = select(params.tail, params.rate, i % params.period < params.leading);
    values[i] -= rate * m / (sqrt(v) * params.correction + params.epsilon);
}
