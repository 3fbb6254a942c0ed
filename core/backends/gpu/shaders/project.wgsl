// Projects every Gaussian into every frame, culls, counts the tiles that it meets. Key of its depth: its bits; the unseen
// come last.
// uses: items, shape, harmonics, splat, standpoints
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> log_scales: array<f32>;
@group(0) @binding(3) var<storage, read> quaternions: array<f32>;
@group(0) @binding(4) var<storage, read> opacity_logits: array<f32>;
@group(0) @binding(5) var<storage, read> sh: array<f32>;
@group(0) @binding(6) var<storage, read_write> splats: array<Splat>;
@group(0) @binding(7) var<storage, read_write> keys: array<u32>;
@group(0) @binding(8) var<storage, read_write> tile_counts: array<u32>;
@group(0) @binding(9) var<storage, read_write> radii: array<f32>;
@group(0) @binding(10) var<storage, read_write> reasons: array<atomic<u32>>;
@group(0) @binding(11) var<storage, read> poses: array<Standpoint>;

fn reason_of(g: u32, s: Shape, splat: ptr<function, Splat>, radius: ptr<function, f32>) -> u32 {
    let mean = vec3f(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]);
    let least = view.cutoff.y;
    let basis = harmonics(s.look);
    var colour = vec3f(0.0);
    var square = 0.0;
    var too_bright = false;
    var finite = all_finite(mean) && is_finite(opacity_logits[g]);
    for (var k = 0u; k < 3u; k++) {
        finite = finite && is_finite(log_scales[3u * g + k]);
    }
    for (var k = 0u; k < 4u; k++) {
        finite = finite && is_finite(quaternions[4u * g + k]);
    }
    for (var k = 0u; k < view.counts.y; k++) {
        let at = 3u * (g * view.counts.y + k);
        let c = vec3f(sh[at], sh[at + 1u], sh[at + 2u]);
        finite = finite && all_finite(c);
        too_bright = too_bright || largest_of(c) > HARMONICS_LIMIT;
        square += dot(c, c);
        colour += basis[k] * c;
    }
    if (!finite) {
        return NON_FINITE;
    }
    if (!(s.point.z > view.frame.z)) {
        return BEHIND;
    }
    let a = s.a0 + s.low;
    let c = s.c0 + s.low;
    let place = view.lens.xy * s.point.xy / s.point.z + view.lens.zw;
    let conic = a / s.determinant;
    let shear = s.b / a;
    let slim = s.determinant / a; // px^2
    let squeeze = slim / (a * s.unit) / s.unit; // (a^2 and unit^2 may leave float32, and their product with them)
    if (s.largest < QUATERNION_MINIMUM_NORM / max(s.length, 1.0) || !(s.length > 0.5)
        || too_bright || square > HARMONICS_LIMIT * HARMONICS_LIMIT
        || !(s.determinant >= DETERMINANT_MINIMUM / s.unit / s.unit) || !(s.point.z < FAR_PLANE)
        || !all_finite(vec3f(place, conic)) || !all_finite(vec3f(shear, slim, squeeze))
        || !all_finite(vec3f(s.determinant, s.unit, s.bare))) {
        return DEGENERATE;
    }
    let opacity = s.opacity * sqrt(share_of(view, s));
    if (!(opacity > least)) {
        return TRANSPARENT;
    }
    let cutoff = 2.0 * log(opacity / least);
    let reached = sqrt(max(cutoff, 0.0));
    let half = vec2f(reached * sqrt(a), reached * sqrt(c)) * s.unit;
    if (any(place + half <= vec2f(0.0)) || any(place - half >= view.frame.xy)) {
        return OUTSIDE;
    }
    // a hair more, so that rounding never skips a tile whose alpha still counts
    let margin = cutoff * 1.0001 + 1e-4;
    let wide = sqrt(margin);
    *radius = max(half.x, half.y);
    colour = max(colour + 0.5, vec3f(0.0));
    (*splat).v[0] = vec4f(place, conic, shear);
    (*splat).v[1] = vec4f(squeeze, opacity, colour.xy);
    (*splat).v[2] = vec4f(colour.z, s.point.z, 0.0, 0.0);
    (*splat).v[3] = vec4f(margin * slim, a / c, shear * wide * sqrt(a) * s.unit, wide * sqrt(c) * s.unit);
    return SEEN;
}

// Into one frame; half the extent of what is seen of it there, 0 where nothing is.
fn project_into(frame: u32, g: u32) -> f32 {
    let s = shape_of(
        view_from(frame),
        vec3f(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]),
        vec3f(log_scales[3u * g], log_scales[3u * g + 1u], log_scales[3u * g + 2u]),
        vec4f(quaternions[4u * g], quaternions[4u * g + 1u], quaternions[4u * g + 2u], quaternions[4u * g + 3u]),
        opacity_logits[g],
    );
    var splat: Splat;
    var radius = 0.0;
    var reason = reason_of(g, s, &splat, &radius);
    var tiles = 0u;
    if (reason == SEEN) {
        let rows = tile_rows(splat, view.frame.y);
        for (var row = rows.x; row < rows.y; row++) {
            let columns = tile_columns(splat, row, view.frame.x);
            tiles += columns.y - columns.x;
        }
        if (tiles == 0u) {
            reason = OUTSIDE;
            radius = 0.0;
        }
    }
    let at = frame * view.counts.x + g;
    splats[at] = splat;
    keys[at] = select(UNSEEN, bitcast<u32>(s.point.z), tiles > 0u);
    tile_counts[at] = tiles;
    atomicAdd(&reasons[reason], 1u);
    atomicAdd(&reasons[REASONS - 1u], tiles);
    return radius;
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let g = item(group, groups, thread, GROUP);
    if (g >= view.counts.x) {
        return;
    }
    var widest = 0.0;
    for (var frame = 0u; frame < view.path.x; frame++) {
        widest = max(widest, project_into(frame, g));
    }
    radii[g] = widest;
}
