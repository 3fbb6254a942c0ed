// Blends each tile's splats, nearest first, over the background; a thread for each pixel.
// uses: view, splat
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> lists: array<vec2u>;
@group(0) @binding(3) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(4) var<storage, read_write> image: array<f32>;
@group(0) @binding(5) var<storage, read_write> transmittance: array<f32>;
@group(0) @binding(6) var<storage, read_write> depth: array<f32>;

@compute @workgroup_size(TILE, TILE)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) thread: vec3u) {
    let pixel = group.xy * TILE + thread.xy;
    let size = vec2u(view.frame.xy);
    if (any(pixel >= size)) {
        return;
    }
    let centre = vec2f(pixel) + 0.5;
    let range = ranges[group.y * view.counts.z + group.x];
    var through = 1.0;
    var colour = vec3f(0.0);
    var deep = 0.0;
    for (var i = range.x; i < range.y && through >= TRANSMITTANCE_STOP; i++) {
        let g = lists[i].x;
        let a = splats[g].v[0];
        let b = splats[g].v[1];
        let d = centre - a.xy;
        let t = d.y - a.w * d.x;
        let alpha = min(b.y * exp(-0.5 * a.z * (t * t + b.x * d.x * d.x)), ALPHA_MAXIMUM);
        if (alpha >= view.cutoff.x) {
            let c = splats[g].v[2];
            let weight = alpha * through;
            colour += weight * vec3f(b.zw, c.x);
            deep += weight * c.y;
            through -= weight;
        }
    }
    let plane = size.x * size.y;
    let at = pixel.y * size.x + pixel.x;
    colour += through * view.background.xyz;
    image[at] = colour.x;
    image[plane + at] = colour.y;
    image[2u * plane + at] = colour.z;
    transmittance[at] = through;
    depth[at] = deep;
}
