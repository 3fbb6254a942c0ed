// Where each tile's pairs begin and end, and each pair's splat and gradient slot.
// uses: items
struct Params { count: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> tiles: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read_write> lists: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> ranges: array<vec2u>;

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
    lists[i] = vec2u(owners[pairs[i]], pairs[i]);
    let tile = tiles[i];
    if (i == 0u || tiles[i - 1u] != tile) {
        ranges[tile].x = i;
    }
    if (i + 1u == params.count || tiles[i + 1u] != tile) {
        ranges[tile].y = i + 1u;
    }
}
