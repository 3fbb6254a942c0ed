// A gradient less a bounded share of what is missing in the render, inside the photo, where it counts (`objective`).
// uses: block, mask
struct Params {
    width: u32, // of the photo
    height: u32,
    margin: u32,        // px that the gradient's frame is larger on every side
    missing_row: u32,   // values between two rows of what is missing, between two planes, and before the first
    missing_plane: u32,
    missing_first: u32,
    masked: u32,        // 0: there is no mask
    mask_plane: u32,    // values between two planes' masks; 0 where all share one
    linear: u32,        // what is missing is linear light
    least: f32,         // of the decoding curve's derivative
    bound: f32,         // w^2 of d / sqrt(d^2 + w^2); 0: the sign
    weight: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> missing: array<f32>;
@group(0) @binding(2) var<storage, read> mask: array<u32>;  // a byte for each value
@group(0) @binding(3) var<storage, read> image: array<f32>; // the render in sRGB and in linear light
@group(0) @binding(4) var<storage, read> light: array<f32>;
@group(0) @binding(5) var<storage, read_write> gradient: array<f32>;

fn derivative(i: u32) -> f32 { // of the decoding curve (`core.colour`)
    if (image[i] > SRGB_KNEE) {
        return SRGB_POWER * light[i] / (image[i] + SRGB_OFFSET);
    }
    return 1.0 / SRGB_SLOPE;
}

@compute @workgroup_size(BLOCK_GROUP)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let blocks_down = (params.height + BLOCK_HIGH - 1u) / BLOCK_HIGH; // of one plane
    let plane = group.y / blocks_down;
    let p = pixel_of(vec3u(group.x, group.y % blocks_down, 0u), thread);
    if (p.x >= params.width || p.y >= params.height) {
        return;
    }
    let at = plane * params.mask_plane + p.y * params.width + p.x;
    if (!in_mask(at)) {
        return;
    }
    let q = p + params.margin;
    let wide = params.width + 2u * params.margin;
    let i = (plane * (params.height + 2u * params.margin) + q.y) * wide + q.x;
    var d = missing[params.missing_first + plane * params.missing_plane + q.y * params.missing_row + q.x];
    if (params.linear == 1u) {
        d /= max(derivative(i), params.least);
    }
    if (params.bound > 0.0) {
        d /= sqrt(d * d + params.bound);
    } else {
        d = sign(d);
    }
    gradient[i] -= params.weight * d;
}
