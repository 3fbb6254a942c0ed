// How often a block has each digit, into counts[digit][block].
// uses: radix
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;

var<workgroup> seen: array<u32, DIGITS * SORT_GROUP>;

@compute @workgroup_size(SORT_GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = group.y * groups.x + group.x;
    let first = block * BLOCK + thread * SORT_RUN;
    // (group memory should begin as zeros; that of Mesa 22's lavapipe keeps what the last order left)
    for (var digit = 0u; digit < DIGITS; digit++) {
        seen[digit * SORT_GROUP + thread] = 0u;
    }
    for (var i = first; i < min(first + SORT_RUN, params.count); i++) {
        seen[digit_of(keys[i], params.shift) * SORT_GROUP + thread] += 1u;
    }
    workgroupBarrier();
    if (thread < DIGITS && block < params.blocks) {
        var sum = 0u;
        for (var t = 0u; t < SORT_GROUP; t++) {
            sum += seen[thread * SORT_GROUP + t];
        }
        counts[thread * params.blocks + block] = sum;
    }
}
