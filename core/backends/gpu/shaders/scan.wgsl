// Prefix sums of a table in place, each value's without itself; the total behind the last. One group does it all.
struct Params { count: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> table: array<u32>;

var<workgroup> sums: array<u32, SCAN_GROUP>;

@compute @workgroup_size(SCAN_GROUP)
fn main(@builtin(local_invocation_index) thread: u32) {
    var before = 0u;
    for (var start = 0u; start < params.count; start += SCAN_GROUP * SCAN_RUN) {
        let first = start + thread * SCAN_RUN;
        let end = min(first + SCAN_RUN, params.count);
        var own = 0u;
        for (var i = first; i < end; i++) {
            own += table[i];
        }
        sums[thread] = own;
        workgroupBarrier();
        for (var step = 1u; step < SCAN_GROUP; step *= 2u) {
            var more = 0u;
            if (thread >= step) {
                more = sums[thread - step];
            }
            workgroupBarrier();
            sums[thread] += more;
            workgroupBarrier();
        }
        var running = before + sums[thread] - own;
        for (var i = first; i < end; i++) {
            let value = table[i];
            table[i] = running;
            running += value;
        }
        before += sums[SCAN_GROUP - 1u];
        workgroupBarrier();
    }
    if (thread == 0u) {
        table[params.count] = before;
    }
}
