// The sum of all groups' sums, by one group, always in the same order.
struct Params { count: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> parts: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> total: array<vec4f>;

var<workgroup> own: array<vec4f, BLOCK_GROUP>;

fn part(i: u32) -> vec4f { // (read in any case: many reads may be under way at once)
    return select(vec4f(0.0), parts[min(i, params.count - 1u)], i < params.count);
}

@compute @workgroup_size(BLOCK_GROUP)
fn main(@builtin(local_invocation_index) thread: u32) {
    var sum = vec4f(0.0);
    for (var i = thread; i < params.count; i += 4u * BLOCK_GROUP) {
        sum += (part(i) + part(i + BLOCK_GROUP)) + (part(i + 2u * BLOCK_GROUP) + part(i + 3u * BLOCK_GROUP));
    }
    own[thread] = sum;
    for (var half = BLOCK_GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (thread < half) {
            own[thread] += own[thread + half];
        }
    }
    if (thread == 0u) {
        total[0] = own[0];
    }
}
