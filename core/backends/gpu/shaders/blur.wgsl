// A symmetric blur along one axis, the edge repeated beyond the frame, or its transpose.
// uses: items
struct Params {
    count: u32,     // values of the result
    inner: u32,     // values between two of the axis
    length: u32,    // of the axis in the result
    source_length: u32,
    margin: i32,
    radius: i32,
    transposed: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> taps: array<f32>; // from the middle to one side; sums of each and those beyond
@group(0) @binding(2) var<storage, read> source: array<f32>;
@group(0) @binding(3) var<storage, read_write> out: array<f32>;

fn value(base: u32, k: i32) -> f32 {
    return source[base + u32(k) * params.inner];
}

fn blurred(base: u32, at: i32) -> f32 {
    let last = i32(params.source_length) - 1;
    let centre = at + params.margin;
    var sum = taps[0] * value(base, centre);
    for (var t = 1; t <= params.radius; t++) {
        sum += taps[t] * (value(base, max(centre - t, 0)) + value(base, min(centre + t, last)));
    }
    return sum;
}

// What the transposed blur brings from the source's value at k to the result's first value, and to its last.
fn to_edges(k: i32) -> vec2f {
    let distances = vec2i(k + params.margin, i32(params.length) - 1 - params.margin - k);
    let held = min(distances, vec2i(params.radius));
    let beyond = vec2f(taps[params.radius + 1 + held.x], taps[params.radius + 1 + held.y]);
    return select(vec2f(0.0), beyond, distances <= vec2i(params.radius));
}

fn transposed(base: u32, at: i32) -> f32 {
    let end = i32(params.source_length);
    var sum = 0.0;
    if (params.length == 1u) {
        return value(base, 0);
    }
    if (at == 0) {
        for (var k = 0; k < min(end, params.radius - params.margin + 1); k++) {
            sum += to_edges(k).x * value(base, k);
        }
        return sum;
    }
    if (at == i32(params.length) - 1) {
        for (var k = max(0, end - 1 - params.radius + params.margin); k < end; k++) {
            sum += to_edges(k).y * value(base, k);
        }
        return sum;
    }
    let middle = at - params.margin;
    for (var k = max(0, middle - params.radius); k < min(end, middle + params.radius + 1); k++) {
        sum += taps[abs(middle - k)] * value(base, k);
    }
    return sum;
}

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
    let at = i32((i / params.inner) % params.length);
    let outer = i / (params.inner * params.length);
    let base = outer * params.inner * params.source_length + i % params.inner;
    if (params.transposed == 1u) {
        out[i] = transposed(base, at);
    } else {
        out[i] = blurred(base, at);
    }
}
