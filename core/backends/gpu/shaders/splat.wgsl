// A projected Gaussian as four vectors, and the tiles that its ellipse meets.
//     0: x, y, conic, shear    1: squeeze, opacity, red, green    2: blue, depth, -, -
//     3: reach, ratio, turn, half height
// alpha = opacity exp(-conic / 2 ((dy - shear dx)^2 + squeeze dx^2)): nothing cancels in a long needle. Where it ends,
// the bracket is `reach`. `ratio` turns these into the same column by column; `turn` is the dy where dx is largest.
struct Splat { v: array<vec4f, 4> }

// First and one past the last row of tiles whose pixel centres the ellipse's box reaches.
fn tile_rows(s: Splat, height: f32) -> vec2u {
    let y = s.v[0].y - 0.5;
    let half = s.v[3].w;
    let first = ceil(clamp(y - half, 0.0, height));
    let last = floor(clamp(y + half, -1.0, height - 1.0));
    if (!(first <= last)) {
        return vec2u(0u);
    }
    return vec2u(u32(first) / TILE, u32(last) / TILE + 1u);
}

// First and one past the last tile in a row of tiles that the ellipse itself meets.
fn tile_columns(s: Splat, row: u32, width: f32) -> vec2u {
    let ratio = s.v[3].y;
    let shear = s.v[0].w * ratio;
    let squeeze = s.v[1].x * ratio * ratio;
    let reach = s.v[3].x * ratio;
    let low = f32(row * TILE) + 0.5 - s.v[0].y;
    let high = low + f32(TILE - 1u);
    let right = clamp(s.v[3].z, low, high);
    let left = clamp(-s.v[3].z, low, high);
    let beyond = reach - squeeze * right * right;
    let before = reach - squeeze * left * left;
    if (!(beyond >= 0.0 && before >= 0.0)) {
        return vec2u(0u);
    }
    let x = s.v[0].x - 0.5;
    let first = ceil(clamp(x + shear * left - sqrt(before), 0.0, width));
    let last = floor(clamp(x + shear * right + sqrt(beyond), -1.0, width - 1.0));
    if (!(first <= last)) {
        return vec2u(0u);
    }
    return vec2u(u32(first) / TILE, u32(last) / TILE + 1u);
}

// Of two splats at the same depth the one that comes first, by what they are rather than where they stand.
fn comes_first(one: Splat, other: Splat) -> bool {
    let left = array<f32, 6>(one.v[0].x, one.v[0].y, one.v[1].y, one.v[1].z, one.v[1].w, one.v[2].x);
    let right = array<f32, 6>(other.v[0].x, other.v[0].y, other.v[1].y, other.v[1].z, other.v[1].w, other.v[2].x);
    for (var k = 0u; k < 6u; k++) {
        if (left[k] != right[k]) {
            return left[k] < right[k];
        }
    }
    return false;
}
