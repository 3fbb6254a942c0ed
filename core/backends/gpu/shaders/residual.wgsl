// Photo less render where a value counts (`objective`), in the middle of a larger frame of zeros.
// uses: block, mask, view
struct Params {
    width: u32, // of the photo
    height: u32,
    margin: u32,     // px left of it and above it
    frame_wide: u32, // of the result
    frame_high: u32,
    masked: u32,     // 0: there is no mask
    mask_plane: u32, // values between two planes' masks; 0 where all share one
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> photo: array<f32>;
@group(0) @binding(2) var<storage, read> blurred: array<f32>;
@group(0) @binding(3) var<storage, read> mask: array<u32>; // a byte for each value
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

fn residual(p: vec2u, plane: u32) -> f32 { // (what lies left of the photo or above it wraps around)
    if (p.x >= params.width || p.y >= params.height) {
        return 0.0;
    }
    let in_plane = p.y * params.width + p.x;
    let at = plane * params.mask_plane + in_plane;
    if (!in_mask(at)) {
        return 0.0;
    }
    let i = plane * params.width * params.height + in_plane;
    if (!is_finite(photo[i]) || !is_finite(blurred[i])) {
        return 0.0;
    }
    let found = photo[i] - blurred[i];
    return select(0.0, found, is_finite(found));
}

@compute @workgroup_size(BLOCK_GROUP)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let blocks_down = (params.frame_high + BLOCK_HIGH - 1u) / BLOCK_HIGH; // of one plane
    let plane = group.y / blocks_down;
    let p = pixel_of(vec3u(group.x, group.y % blocks_down, 0u), thread);
    if (p.x < params.frame_wide && p.y < params.frame_high) {
        out[(plane * params.frame_high + p.y) * params.frame_wide + p.x] = residual(p - params.margin, plane);
    }
}
