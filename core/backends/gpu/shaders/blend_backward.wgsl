// Gradients of a tile's pixels in its splats, one slot for each pair of a splat and a tile; nothing is added by two
// threads, so the sums are the same every time. A thread takes a splat, and pixels pass by: thread k sees a pixel one
// step after thread k - 1, and finds its transmittance, and what still comes behind, as that one left them. It runs
// front to back: the final colour is known, so what lies behind is the rest of a running sum, and nothing is ever
// divided by transmittance.
// uses: view, splat
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> lists: array<vec2u>;
@group(0) @binding(3) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(4) var<storage, read> image: array<f32>;
@group(0) @binding(5) var<storage, read> transmittance: array<f32>;
@group(0) @binding(6) var<storage, read> depth: array<f32>;
@group(0) @binding(7) var<storage, read> image_gradient: array<f32>;
@group(0) @binding(8) var<storage, read> alpha_gradient: array<f32>;
@group(0) @binding(9) var<storage, read> depth_gradient: array<f32>;
@group(0) @binding(10) var<storage, read_write> slots: array<f32>;

const PIXELS = u32(TILE * TILE);

var<workgroup> through: array<f32, PIXELS>;
var<workgroup> rest: array<f32, PIXELS>;
var<workgroup> upstream: array<vec4f, PIXELS>; // of the colours, and of the depth

fn read_pixel(p: u32, corner: vec2u) {
    let pixel = corner + vec2u(p % TILE, p / TILE);
    let size = vec2u(view.frame.xy);
    through[p] = 0.0; // (beside the frame nothing counts)
    if (any(pixel >= size)) {
        return;
    }
    let plane = size.x * size.y;
    let at = pixel.y * size.x + pixel.x;
    let g = vec3f(image_gradient[at], image_gradient[plane + at], image_gradient[2u * plane + at]);
    let shown = vec3f(image[at], image[plane + at], image[2u * plane + at]);
    through[p] = 1.0;
    upstream[p] = vec4f(g, depth_gradient[at]);
    // image = colours + T background and alpha = 1 - T: both are part of what still comes
    rest[p] = dot(g, shown) + depth_gradient[at] * depth[at] - alpha_gradient[at] * transmittance[at];
}

@compute @workgroup_size(BUCKET)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let range = ranges[group.y * view.counts.z + group.x];
    let corner = group.xy * TILE;
    for (var p = thread; p < PIXELS; p += BUCKET) {
        read_pixel(p, corner);
    }
    workgroupBarrier();
    for (var first = range.x; first < range.y; first += BUCKET) {
        let i = first + thread;
        let present = i < range.y;
        let pair = lists[min(i, range.y - 1u)];
        let a = splats[pair.x].v[0];
        let b = splats[pair.x].v[1];
        let c = splats[pair.x].v[2];
        let content = vec4f(b.zw, c.xy);
        var moments = vec3f(0.0); // s dx, s t, s
        var squares = vec3f(0.0); // s dx^2, s dx t, s t^2
        var seen = vec4f(0.0);
        for (var step = 0u; step < PIXELS + BUCKET - 1u; step++) {
            let p = step - thread;
            if (present && step >= thread && p < PIXELS && through[p] >= TRANSMITTANCE_STOP) {
                let d = vec2f(corner + vec2u(p % TILE, p / TILE)) + 0.5 - a.xy;
                let t = d.y - a.w * d.x;
                let raw = b.y * exp(-0.5 * a.z * (t * t + b.x * d.x * d.x));
                if (min(raw, ALPHA_MAXIMUM) >= view.cutoff.x) {
                    let alpha = min(raw, ALPHA_MAXIMUM);
                    let before = through[p];
                    let weight = alpha * before;
                    let value = dot(upstream[p], content);
                    let behind = rest[p] - weight * value;
                    rest[p] = behind;
                    through[p] = before - weight;
                    seen += weight * upstream[p];
                    if (raw < ALPHA_MAXIMUM) {
                        let s = alpha * (before * value - behind / (1.0 - alpha));
                        moments += s * vec3f(d.x, t, 1.0);
                        squares += s * vec3f(d.x * d.x, d.x * t, t * t);
                    }
                }
            }
            workgroupBarrier();
        }
        if (present) {
            let to = pair.y * SLOT_WIDTH;
            slots[to] = moments.x;
            slots[to + 1u] = moments.y;
            slots[to + 2u] = squares.x;
            slots[to + 3u] = squares.y;
            slots[to + 4u] = squares.z;
            slots[to + 5u] = moments.z;
            slots[to + 6u] = seen.x;
            slots[to + 7u] = seen.y;
            slots[to + 8u] = seen.z;
            slots[to + 9u] = seen.w;
        }
    }
}
