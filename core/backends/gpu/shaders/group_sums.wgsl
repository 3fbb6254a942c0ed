// Prefix sums of the SCAN_GROUP values of a group's threads, one each.
// (in turns from one half to the other, so that a step needs one barrier)
var<workgroup> ladder: array<u32, 2u * SCAN_GROUP>;

// The sum of the values of the threads before this one, and that of all of them. All threads of a group call it.
fn sums_before(thread: u32, own: u32) -> vec2u {
    workgroupBarrier();  // others may still read what the last call found
    var half = 0u;
    ladder[thread] = own;
    workgroupBarrier();
    for (var step = 1u; step < SCAN_GROUP; step *= 2u) {
        var sum = ladder[half + thread];
        if (thread >= step) {
            sum += ladder[half + thread - step];
        }
        half = SCAN_GROUP - half;
        ladder[half + thread] = sum;
        workgroupBarrier();
    }
    return vec2u(ladder[half + thread] - own, ladder[half + SCAN_GROUP - 1u]);
}
