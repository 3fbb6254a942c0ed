// Photo and render with grey where a value of the photo does not count: it is masked, or not finite; 1 where it counts;
// each group's number of those that do.
// uses: window, view
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> photo: array<f32>;
@group(0) @binding(3) var<storage, read> mask: array<u32>; // bytes of one plane or of all, again and again
@group(0) @binding(4) var<storage, read_write> filled: array<vec2f>;
@group(0) @binding(5) var<storage, read_write> weights: array<f32>;
@group(0) @binding(6) var<storage, read_write> sums: array<vec2f>;

var<workgroup> own: array<f32, GROUP>;

fn counts(i: u32) -> bool {
    if (!is_finite(photo[i])) {
        return false;
    }
    if (params.masked == 0u) {
        return true;
    }
    let at = i % params.masked;
    return ((mask[at / 4u] >> (8u * (at & 3u))) & 0xffu) != 0u;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = item(group, groups, thread, GROUP);
    own[thread] = 0.0;
    if (i < params.count) {
        if (counts(i)) {
            own[thread] = 1.0;
            filled[i] = vec2f(image[i], photo[i]);
        } else {
            filled[i] = vec2f(PHOTO_FILL);
        }
        weights[i] = own[thread];
    }
    workgroupBarrier();
    let block = group.y * groups.x + group.x;
    if (thread == 0u && block * GROUP < params.count) {
        var sum = 0.0;
        for (var t = 0u; t < GROUP; t++) {
            sum += own[t];
        }
        sums[block] = vec2f(sum, 0.0);
    }
}
