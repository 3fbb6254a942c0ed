// How often a chunk has each digit of the first pass; and no digit of the second one yet.
// uses: radix
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;
@group(0) @binding(3) var<storage, read_write> next_counts: array<u32>;

var<workgroup> seen: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(SCAN_GROUP)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    // (group memory should begin as zeros; that of Mesa 22's lavapipe keeps what the last order left)
    atomicStore(&seen[thread], 0u);
    workgroupBarrier();
    let first = group.x * params.chunk;
    let end = min(first + params.chunk, params.count);
    for (var i = first + thread; i < end; i += SCAN_GROUP) {
        atomicAdd(&seen[(keys[i] >> params.shift) & params.mask], 1u);
    }
    workgroupBarrier();
    counts[group.x * DIGITS + thread] = atomicLoad(&seen[thread]);
    next_counts[group.x * DIGITS + thread] = 0u;
}
