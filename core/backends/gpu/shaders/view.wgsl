// Camera and settings, as `rasterizer.view_numbers` packs them.
struct View {
    rotation: array<vec4f, 3>, // rows; the fourth values are the camera's centre
    centre_rest: vec4f,        // what rounding took from the centre: worlds may lie far from their origin
    lens: vec4f,               // fx, fy, cx, cy
    limits: vec4f,             // x / z and y / z are clamped to them: least and largest
    frame: vec4f,              // width, height, near plane, low-pass
    cutoff: vec4f,             // alpha's least, where ellipses end, 1 if antialiased, 1 if a backward pass may come
    background: vec4f,         // and for the backward pass which gradients came: 1 image, 2 alpha, 4 depth
    counts: vec4u,             // Gaussians, harmonics of each, tiles across, tiles down
    path: vec4u,               // frames along a camera's path, 1 of a photo from one place; for `find_surface` the bits of
                               // how much light passes; -, -
}

fn is_finite(value: f32) -> bool { // by its bits: a compiler may take for granted that every number is finite
    return (bitcast<u32>(value) & 0x7f800000u) != 0x7f800000u;
}

fn all_finite(value: vec3f) -> bool {
    return is_finite(value.x) && is_finite(value.y) && is_finite(value.z);
}
