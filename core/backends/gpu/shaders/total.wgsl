// The sum of pairs of numbers, by one group, always in the same order; it goes to a place of its own.
struct Params { count: u32, place: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> parts: array<vec2f>;
@group(0) @binding(2) var<storage, read_write> total: array<vec2f>;

var<workgroup> own: array<vec2f, SCAN_GROUP>;

@compute @workgroup_size(SCAN_GROUP)
fn main(@builtin(local_invocation_index) thread: u32) {
    var sum = vec2f(0.0);
    for (var i = thread; i < params.count; i += SCAN_GROUP) {
        sum += parts[i];
    }
    own[thread] = sum;
    for (var half = SCAN_GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (thread < half) {
            own[thread] += own[thread + half];
        }
    }
    if (thread == 0u) {
        total[params.place] = own[0];
    }
}
