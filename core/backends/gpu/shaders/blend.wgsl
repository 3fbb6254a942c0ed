// Blends each tile's splats, nearest first, over the background, frame below frame; a thread for each pixel. The group fetches a chunk of
// the list into its own memory at once, as a thread that reads one splat after the other waits for each. Where a
// backward pass may come, every chunk leaves what it begins at, for `blend_backward` to take chunks side by side.
// uses: view, splat, chunks
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> lists: array<vec2u>;
@group(0) @binding(3) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(4) var<storage, read_write> chunks: array<Chunk>;
@group(0) @binding(5) var<storage, read_write> checkpoints: array<f32>;
@group(0) @binding(6) var<storage, read_write> image: array<f32>;
@group(0) @binding(7) var<storage, read_write> transmittance: array<f32>;
@group(0) @binding(8) var<storage, read_write> depth: array<f32>;
@group(0) @binding(9) var<storage, read_write> opacity: array<f32>;

struct Pixel { through: f32, colour: vec3f, deep: f32 }

var<workgroup> shapes: array<vec4f, CHUNK>;  // x, y, conic, shear
var<workgroup> weights: array<vec4f, CHUNK>; // squeeze, opacity, red, green
var<workgroup> others: array<vec4f, CHUNK>;  // blue, depth, reach
var<workgroup> last_open: atomic<u32>; // the last chunk that some pixel still looks for
var<workgroup> open: u32;

fn fetch(first: u32, count: u32, thread: u32) {
    if (thread < count) {
        let g = lists[first + thread].x;
        let end = splats[g].v[3].x;
        shapes[thread] = splats[g].v[0];
        weights[thread] = splats[g].v[1];
        // (without a cutoff everything counts, however far outside)
        others[thread] = vec4f(splats[g].v[2].xy, select(3e38, end, view.cutoff.x > 0.0), 0.0);
    }
}

fn blend_chunk(given: Pixel, centre: vec2f, count: u32) -> Pixel {
    var pixel = given;
    for (var k = 0u; k < count && pixel.through >= TRANSMITTANCE_STOP; k++) {
        let a = shapes[k];
        let b = weights[k];
        let c = others[k];
        let d = centre - a.xy;
        let t = d.y - a.w * d.x;
        let bracket = t * t + b.x * d.x * d.x;
        if (bracket > c.z) { // (spares the exponential; `reach` has a margin, so alpha is below its least)
            continue;
        }
        let alpha = min(b.y * exp(-0.5 * a.z * bracket), ALPHA_MAXIMUM);
        if (alpha >= view.cutoff.x) {
            let weight = alpha * pixel.through;
            pixel.colour += weight * vec3f(b.zw, c.x);
            pixel.deep += weight * c.y;
            pixel.through -= weight;
        }
    }
    return pixel;
}

fn leave_checkpoint(pixel: Pixel, number: u32, thread: u32) {
    let at = number * CHECKPOINT * PIXELS + thread;
    checkpoints[at] = pixel.through;
    checkpoints[at + PIXELS] = pixel.colour.x;
    checkpoints[at + 2u * PIXELS] = pixel.colour.y;
    checkpoints[at + 3u * PIXELS] = pixel.colour.z;
    checkpoints[at + 4u * PIXELS] = pixel.deep;
}

// Chunks of all tiles stand in one row with gaps: no two have one number, and none had to count those before it.
fn leave_chunk(range: vec2u, tile: u32, chunk: u32, reached: bool) {
    let first = range.x + chunk * CHUNK;
    let begins = select(checkpoint_of(range.x, chunk), FRESH, chunk == 0u);
    chunks[range.x / CHUNK + tile + chunk] =
        Chunk(first, min(first + CHUNK, range.y), tile, select(SATURATED, begins, reached));
}

fn show(pixel: Pixel, place: vec2u, size: vec2u, frame: u32) {
    let plane = size.x * size.y;
    let within = place.y * size.x + place.x;
    let at = frame * plane + within;
    let colour = pixel.colour + pixel.through * view.background.xyz;
    image[3u * frame * plane + within] = colour.x;
    image[(3u * frame + 1u) * plane + within] = colour.y;
    image[(3u * frame + 2u) * plane + within] = colour.z;
    transmittance[at] = pixel.through;
    depth[at] = pixel.deep;
    opacity[at] = 1.0 - pixel.through;
}

@compute @workgroup_size(TILE, TILE)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) within: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let frame = group.y / view.counts.w;
    let place = vec2u(group.x, group.y % view.counts.w) * TILE + within.xy;
    let size = vec2u(view.frame.xy);
    let visible = all(place < size);
    let tile = group.y * view.counts.z + group.x;
    let range = ranges[tile];
    let count = (range.y - range.x + CHUNK - 1u) / CHUNK;
    // (pixels beside the frame take part in what the group does together, and see nothing)
    var pixel = Pixel(select(0.0, 1.0, visible), vec3f(0.0), 0.0);
    var reached = count;
    if (thread == 0u) { // (wgpu leaves in a group's memory whatever stood there)
        atomicStore(&last_open, 0u);
    }
    for (var chunk = 0u; chunk < count; chunk++) {
        if (chunk > 0u) {
            if (pixel.through >= TRANSMITTANCE_STOP) {
                atomicMax(&last_open, chunk);
            }
            workgroupBarrier();
            if (thread == 0u) {
                open = atomicLoad(&last_open);
            }
            if (workgroupUniformLoad(&open) < chunk) {
                reached = chunk;
                break;
            }
            if (view.cutoff.w > 0.0) {
                leave_checkpoint(pixel, checkpoint_of(range.x, chunk), thread);
            }
        }
        let first = range.x + chunk * CHUNK;
        let length = min(CHUNK, range.y - first);
        fetch(first, length, thread);
        workgroupBarrier();
        pixel = blend_chunk(pixel, vec2f(place) + 0.5, length);
    }
    if (view.cutoff.w > 0.0) {
        for (var chunk = thread; chunk < count; chunk += PIXELS) {
            leave_chunk(range, tile, chunk, chunk < reached);
        }
    }
    if (visible) {
        show(pixel, place, size, frame);
    }
}
