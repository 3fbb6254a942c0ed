// Gradients of a tile's pixels in its splats, one slot for each pair of a splat and a tile; nothing is added by two
// threads, so the sums are the same every time. A group takes a chunk of the tile's list, from the checkpoint that the
// forward pass left there. A thread takes up to four splats that follow each other, and pixels pass by: thread k sees a
// pixel one step after thread k - 1, and finds its transmittance, and what still comes behind, as that one left them.
// It runs front to back: the final colour is known, so what lies behind is the rest of a running sum, and nothing is
// ever divided by transmittance.
// uses: items, view, splat, chunks
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> lists: array<vec2u>;
@group(0) @binding(3) var<storage, read> chunks: array<Chunk>;
@group(0) @binding(4) var<storage, read> checkpoints: array<f32>;
@group(0) @binding(5) var<storage, read> image: array<f32>;
@group(0) @binding(6) var<storage, read> transmittance: array<f32>;
@group(0) @binding(7) var<storage, read> depth: array<f32>;
@group(0) @binding(8) var<storage, read> image_gradient: array<f32>;
@group(0) @binding(9) var<storage, read> alpha_gradient: array<f32>;
@group(0) @binding(10) var<storage, read> depth_gradient: array<f32>;
@group(0) @binding(11) var<storage, read_write> slots: array<vec2f>;

// A splat that a thread holds, and what it has added up so far.
struct Held {
    shape: vec4f,   // x, y, conic, shear
    squeeze: f32,
    opacity: f32,
    content: vec4f, // colour, depth
    moments: vec3f, // s dx, s t, s
    squares: vec3f, // s dx^2, s dx t, s t^2
    seen: vec4f,
}

var<workgroup> states: array<vec2f, PIXELS>;   // transmittance, and what still comes
var<workgroup> upstream: array<vec4f, PIXELS>; // of the colours, and of the depth

fn read_pixel(p: u32, corner: vec2u, frame: u32, begins: u32) {
    let pixel = corner + vec2u(p % TILE, p / TILE);
    let size = vec2u(view.frame.xy);
    states[p] = vec2f(0.0); // (beside the frame nothing counts)
    upstream[p] = vec4f(0.0);
    if (any(pixel >= size)) {
        return;
    }
    let plane = size.x * size.y;
    let within = pixel.y * size.x + pixel.x;
    let at = frame * plane + within;
    let red = 3u * frame * plane + within;
    var through = 1.0;
    var colour = vec3f(image[red], image[plane + red], image[2u * plane + red]);
    var deep = depth[at];
    if (begins != FRESH) {
        let stored = begins * CHECKPOINT * PIXELS + p;
        through = checkpoints[stored];
        colour -= vec3f(checkpoints[stored + PIXELS], checkpoints[stored + 2u * PIXELS], checkpoints[stored + 3u * PIXELS]);
        deep -= checkpoints[stored + 4u * PIXELS];
    }
    let came = u32(view.background.w);
    var g = vec4f(0.0);
    if ((came & 1u) != 0u) {
        g = vec4f(image_gradient[red], image_gradient[plane + red], image_gradient[2u * plane + red], 0.0);
    }
    if ((came & 4u) != 0u) {
        g.w = depth_gradient[at];
    }
    upstream[p] = g;
    // image = colours + T background and alpha = 1 - T: both are part of what still comes
    var rest = dot(g, vec4f(colour, deep));
    if ((came & 2u) != 0u) {
        rest -= alpha_gradient[at] * transmittance[at];
    }
    states[p] = vec2f(through, rest);
}

// (where the list has ended: one of no opacity, which changes no pixel)
fn taken(i: u32, end: u32) -> Held {
    var held: Held;
    if (i < end) {
        let g = lists[i].x;
        let b = splats[g].v[1];
        held.shape = splats[g].v[0];
        held.squeeze = b.x;
        held.opacity = b.y;
        held.content = vec4f(b.zw, splats[g].v[2].xy);
    }
    return held;
}

// Adds a pixel's share to a splat's sums; the pixel's state behind it.
fn pass_by(held: ptr<function, Held>, centre: vec2f, g: vec4f, state: vec2f) -> vec2f {
    let d = centre - (*held).shape.xy;
    let t = d.y - (*held).shape.w * d.x;
    let raw = (*held).opacity * exp(-0.5 * (*held).shape.z * (t * t + (*held).squeeze * d.x * d.x));
    let alpha = min(raw, ALPHA_MAXIMUM);
    if (!(alpha >= view.cutoff.x && state.x >= TRANSMITTANCE_STOP)) {
        return state;
    }
    let weight = alpha * state.x;
    let value = dot(g, (*held).content);
    let behind = state.y - weight * value;
    (*held).seen += weight * g;
    if (raw < ALPHA_MAXIMUM) {
        let s = alpha * (state.x * value - behind / (1.0 - alpha));
        let sx = s * d.x;
        let st = s * t;
        (*held).moments += vec3f(sx, st, s);
        (*held).squares += vec3f(sx * d.x, sx * t, st * t);
    }
    return vec2f(state.x - weight, behind);
}

fn put(held: Held, i: u32, end: u32) {
    if (i < end) {
        let to = lists[i].y * (SLOT_WIDTH / 2u);
        slots[to] = held.moments.xy;
        slots[to + 1u] = held.squares.xy;
        slots[to + 2u] = vec2f(held.squares.z, held.moments.z);
        slots[to + 3u] = held.seen.xy;
        slots[to + 4u] = held.seen.zw;
    }
}

fn put_nothing(chunk: Chunk, thread: u32) {
    var nothing: Held;
    for (var i = chunk.first + thread; i < chunk.end; i += BUCKET) {
        put(nothing, i, chunk.end);
    }
}

@compute @workgroup_size(BUCKET)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = item(group, groups, 0u, 1u);
    if (number >= arrayLength(&chunks)) {
        return;
    }
    let chunk = chunks[number];
    if (chunk.first >= chunk.end) { // (a gap in the row)
        return;
    }
    if (chunk.begins == SATURATED) {
        put_nothing(chunk, thread);
        return;
    }
    let row = chunk.tile / view.counts.z; // of the tiles of all frames
    let frame = row / view.counts.w;
    let corner = vec2u(chunk.tile % view.counts.z, row % view.counts.w) * TILE;
    for (var p = thread; p < PIXELS; p += BUCKET) {
        read_pixel(p, corner, frame, chunk.begins);
    }
    // as few splats to a thread as there are: every thread of a short list is at work
    let run = (chunk.end - chunk.first + BUCKET - 1u) / BUCKET;
    let first = chunk.first + run * thread;
    let end = min(first + run, chunk.end);
    var one = taken(first, end);
    var two = taken(first + 1u, end);
    var three = taken(first + 2u, end);
    var four = taken(first + 3u, end);
    workgroupBarrier();
    for (var step = 0u; step < PIXELS + BUCKET - 1u; step++) {
        let p = step - thread; // (what lies before the first pixel wraps to beyond the last)
        if (p < PIXELS && first < end) {
            let centre = vec2f(corner + vec2u(p % TILE, p / TILE)) + 0.5;
            let g = upstream[p];
            var state = pass_by(&one, centre, g, states[p]);
            if (run > 1u) {
                state = pass_by(&two, centre, g, state);
            }
            if (run > 2u) {
                state = pass_by(&three, centre, g, state);
            }
            if (run > 3u) {
                state = pass_by(&four, centre, g, state);
            }
            states[p] = state;
        }
        workgroupBarrier();
    }
    put(one, first, end);
    put(two, first + 1u, end);
    put(three, first + 2u, end);
    put(four, first + 3u, end);
}
