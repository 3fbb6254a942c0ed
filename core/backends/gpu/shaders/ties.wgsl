// Puts splats of exactly one depth into the order of what they are, and reads off how many tiles each one meets.
// uses: items, splat
struct Params { count: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> indices: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<Splat>;
@group(0) @binding(4) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(5) var<storage, read_write> order: array<u32>;
@group(0) @binding(6) var<storage, read_write> places: array<u32>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = item(group, groups, thread, GROUP);
    if (i >= params.count) {
        return;
    }
    let key = keys[i];
    let g = indices[i];
    var first = i;
    var end = i + 1u;
    if (key != UNSEEN) {
        while (first > 0u && i - first <= TIE_LIMIT && keys[first - 1u] == key) {
            first--;
        }
        while (end < params.count && end - i <= TIE_LIMIT && keys[end] == key) {
            end++;
        }
    }
    var to = i;
    if (end - first > 1u && end - first <= TIE_LIMIT) {
        to = first;
        let own = splats[g];
        for (var j = first; j < end; j++) {
            let other = splats[indices[j]];
            let before = comes_first(other, own);
            to += select(0u, 1u, before || (j < i && !comes_first(own, other)));
        }
    }
    order[to] = g;
    places[to] = tile_counts[g];
}
