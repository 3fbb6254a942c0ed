// Prefix sums of a table in place, each value's without itself; the total behind the last. A group takes a chunk, and
// first adds up the totals of those before it.
// uses: group_sums
struct Params { count: u32, chunk: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> totals: array<u32>;
@group(0) @binding(2) var<storage, read_write> table: array<u32>;

@compute @workgroup_size(SCAN_GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    var own = 0u;
    for (var chunk = thread; chunk < group.x; chunk += SCAN_GROUP) {
        own += totals[chunk];
    }
    var before = sums_before(thread, own).y;
    let end = min((group.x + 1u) * params.chunk, params.count);
    for (var start = group.x * params.chunk; start < end; start += SCAN_GROUP * SCAN_RUN) {
        let first = start + thread * SCAN_RUN;
        let last = min(first + SCAN_RUN, end);
        own = 0u;
        for (var i = first; i < last; i++) {
            own += table[i];
        }
        let sums = sums_before(thread, own);
        var running = before + sums.x;
        for (var i = first; i < last; i++) {
            let value = table[i];
            table[i] = running;
            running += value;
        }
        before += sums.y;
    }
    if (thread == 0u && group.x + 1u == groups.x) {
        table[params.count] = before;
    }
}
