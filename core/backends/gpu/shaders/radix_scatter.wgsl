// Puts keys and values where `counts`, after its prefix sums, says that the block's digits begin.
// uses: radix
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<u32>;
@group(0) @binding(3) var<storage, read> counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_values: array<u32>;

var<workgroup> places: array<u32, DIGITS * SORT_GROUP>;

@compute @workgroup_size(SORT_GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = group.y * groups.x + group.x;
    let first = block * BLOCK + thread * SORT_RUN;
    let end = min(first + SORT_RUN, params.count);
    for (var digit = 0u; digit < DIGITS; digit++) {
        places[digit * SORT_GROUP + thread] = 0u;
    }
    for (var i = first; i < end; i++) {
        places[digit_of(keys[i], params.shift) * SORT_GROUP + thread] += 1u;
    }
    workgroupBarrier();
    if (thread < DIGITS && block < params.blocks) {
        var running = counts[thread * params.blocks + block];
        for (var t = 0u; t < SORT_GROUP; t++) {
            let own = places[thread * SORT_GROUP + t];
            places[thread * SORT_GROUP + t] = running;
            running += own;
        }
    }
    workgroupBarrier();
    for (var i = first; i < end; i++) {
        let place = digit_of(keys[i], params.shift) * SORT_GROUP + thread;
        let to = places[place];
        places[place] = to + 1u;
        sorted_keys[to] = keys[i];
        sorted_values[to] = values[i];
    }
}
