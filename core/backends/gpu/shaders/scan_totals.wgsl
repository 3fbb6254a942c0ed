// The first of two orders for prefix sums: what the values of every chunk add up to. A group takes a chunk.
// uses: group_sums
struct Params { count: u32, chunk: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> table: array<u32>;
@group(0) @binding(2) var<storage, read_write> totals: array<u32>;

@compute @workgroup_size(SCAN_GROUP)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let first = group.x * params.chunk;
    let end = min(first + params.chunk, params.count);
    var own = 0u;
    for (var i = first + thread; i < end; i += SCAN_GROUP) {
        own += table[i];
    }
    let sums = sums_before(thread, own);
    if (thread == 0u) {
        totals[group.x] = sums.y;
    }
}
