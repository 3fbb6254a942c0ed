// How far away the splat is behind which each pixel passes no more than a share of its light, 0 where none is; the tile's
// splats are fetched as in `blend`.
// uses: view, splat
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> lists: array<vec2u>;
@group(0) @binding(3) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(4) var<storage, read_write> surface: array<f32>;

var<workgroup> shapes: array<vec4f, CHUNK>; // x, y, conic, shear
var<workgroup> others: array<vec4f, CHUNK>; // squeeze, opacity, depth
var<workgroup> looking: atomic<u32>;        // the last chunk that some pixel still looks for
var<workgroup> goes_on: u32;

fn fetch(first: u32, count: u32, thread: u32) {
    if (thread < count) {
        let g = lists[first + thread].x;
        shapes[thread] = splats[g].v[0];
        others[thread] = vec4f(splats[g].v[1].xy, splats[g].v[2].y, 0.0);
    }
}

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) within: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let place = group.xy * TILE + within.xy;
    let size = vec2u(view.frame.xy);
    let visible = all(place < size);
    let range = ranges[group.y * view.counts.z + group.x];
    let level = bitcast<f32>(view.path.y);
    let centre = vec2f(place) + 0.5;
    var through = select(0.0, 1.0, visible);
    var found = 0.0;
    if (thread == 0u) {
        atomicStore(&looking, 0u);
    }
    workgroupBarrier();
    let chunks = (range.y - range.x + CHUNK - 1u) / CHUNK;
    for (var chunk = 0u; chunk < chunks; chunk++) {
        if (through > level) {
            atomicMax(&looking, chunk + 1u);
        }
        workgroupBarrier();
        if (thread == 0u) {
            goes_on = atomicLoad(&looking);
        }
        if (workgroupUniformLoad(&goes_on) <= chunk) {
            break;
        }
        let first = range.x + chunk * CHUNK;
        let count = min(CHUNK, range.y - first);
        fetch(first, count, thread);
        workgroupBarrier();
        for (var k = 0u; k < count && through > level; k++) {
            let a = shapes[k];
            let b = others[k];
            let d = centre - a.xy;
            let t = d.y - a.w * d.x;
            let alpha = min(b.y * exp(-0.5 * a.z * (t * t + b.x * d.x * d.x)), ALPHA_MAXIMUM);
            if (alpha >= view.cutoff.x) {
                through -= alpha * through;
                if (through <= level) {
                    found = b.z;
                }
            }
        }
    }
    if (visible) {
        surface[place.y * size.x + place.x] = found;
    }
}
