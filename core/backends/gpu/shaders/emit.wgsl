// Writes a pair for every tile that a splat meets, splats from near to far: its tile, and itself by its number. Frames of
// a path have tiles and splats of their own, one frame's behind the other's.
// uses: items, view, splat
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> places: array<u32>;
@group(0) @binding(4) var<storage, read_write> tiles: array<u32>;
@group(0) @binding(5) var<storage, read_write> owners: array<u32>;
@group(0) @binding(6) var<storage, read_write> slots: array<vec2u>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = item(group, groups, thread, GROUP);
    if (i >= view.counts.x * view.path.x) {
        return;
    }
    let g = order[i];
    var at = places[i];
    let end = places[i + 1u];
    if (at == end) {
        slots[g] = vec2u(0u);
        return;
    }
    let splat = splats[g];
    let above = g / view.counts.x * view.counts.w; // rows of tiles of the frames before
    let rows = tile_rows(splat, view.frame.y);
    for (var row = rows.x; row < rows.y; row++) {
        let columns = tile_columns(splat, row, view.frame.x);
        for (var column = columns.x; column < columns.y && at < end; column++) {
            tiles[at] = (above + row) * view.counts.z + column;
            owners[at] = g;
            at++;
        }
    }
    slots[g] = vec2u(places[i], at);
    // (another shader's rounding may have counted one tile more: a tile that is not there takes it, and no gradient)
    for (; at < end; at++) {
        tiles[at] = view.counts.z * view.counts.w * view.path.x;
        owners[at] = g;
    }
}
