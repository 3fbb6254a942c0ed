// From the gradients on the screen to those of the parameters and of the pose; the mirror of project and shape. A thread
// takes its Gaussian through all frames of a path, one after the other, and adds up what they ask for.
// uses: items, shape, harmonics, standpoints
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> log_scales: array<f32>;
@group(0) @binding(3) var<storage, read> quaternions: array<f32>;
@group(0) @binding(4) var<storage, read> opacity_logits: array<f32>;
@group(0) @binding(5) var<storage, read> sh: array<f32>;
@group(0) @binding(6) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(7) var<storage, read> slots: array<vec2f>;
@group(0) @binding(8) var<storage, read_write> out: array<f32>; // planes: parameters as they are stored, then the screen's
@group(0) @binding(9) var<storage, read_write> pose: array<f32>; // of one frame: along a path poses have no gradient
@group(0) @binding(10) var<storage, read> poses: array<Standpoint>;

// A Gaussian's gradient on the screen, in the order of its slots (`layout`).
struct Sums { moments: vec2f, wide: vec2f, high: vec2f, seen: vec2f, far: vec2f }

var<workgroup> of_pose: array<f32, POSE_SUMS * GROUP>;
var<workgroup> parts: array<Sums, GROUP>;
var<private> adds: bool; // whether an earlier frame left something in `out`

// Of every so manieth slot between two.
fn summed(first: u32, end: u32, step: u32) -> Sums {
    var sums: Sums;
    for (var slot = first; slot < end; slot += step) {
        let at = slot * (SLOT_WIDTH / 2u);
        sums.moments += slots[at];
        sums.wide += slots[at + 1u];
        sums.high += slots[at + 2u];
        sums.seen += slots[at + 3u];
        sums.far += slots[at + 4u];
    }
    return sums;
}

fn together(one: Sums, other: Sums) -> Sums {
    return Sums(
        one.moments + other.moments,
        one.wide + other.wide,
        one.high + other.high,
        one.seen + other.seen,
        one.far + other.far,
    );
}

// The sums of each thread's Gaussian. Slots that are read one after the other are waited for one after the other: those
// of a Gaussian that fills the frame are shared out among the group's threads.
fn sums_of(block: u32, thread: u32, frame: u32) -> Sums {
    var own: Sums;
    let g = block * GROUP + thread;
    let others = frame * view.counts.x;
    if (g < view.counts.x && ranges[others + g].y - ranges[others + g].x <= GROUP) {
        own = summed(ranges[others + g].x, ranges[others + g].y, 1u);
    }
    for (var k = 0u; k < GROUP && block * GROUP + k < view.counts.x; k++) {
        let range = ranges[others + block * GROUP + k];
        if (range.y - range.x > GROUP) {
            parts[thread] = summed(range.x + thread, range.y, GROUP);
            workgroupBarrier();
            if (thread == k) {
                for (var t = 0u; t < GROUP; t++) {
                    own = together(own, parts[t]);
                }
            }
            workgroupBarrier();
        }
    }
    return own;
}

fn put_one(at: u32, value: f32) {
    if (adds) {
        out[at] += value;
    } else {
        out[at] = value;
    }
}

fn put(at: u32, value: vec3f) {
    put_one(at, value.x);
    put_one(at + 1u, value.y);
    put_one(at + 2u, value.z);
}

// From the gradient of a rotation matrix (by columns) to that of its unit quaternion, across its length.
fn quaternion_gradient(q: vec4f, r: mat3x3f) -> vec4f {
    let turn = vec3f(r[1][2] - r[2][1], r[2][0] - r[0][2], r[0][1] - r[1][0]);
    let both = vec3f(r[1][0] + r[0][1], r[2][0] + r[0][2], r[2][1] + r[1][2]); // xy, xz, yz
    let d = 2.0 * vec4f(
        dot(q.yzw, turn),
        q.x * turn.x + q.z * both.x + q.w * both.y - 2.0 * q.y * (r[1][1] + r[2][2]),
        q.x * turn.y + q.y * both.x + q.w * both.z - 2.0 * q.z * (r[0][0] + r[2][2]),
        q.x * turn.z + q.y * both.y + q.z * both.z - 2.0 * q.w * (r[0][0] + r[1][1]),
    );
    return d - dot(d, q) * q;
}

// Gradients on the screen: of the centre, of the rows of U = J V, and of the scales' logarithms.
struct OnScreen { centre: vec2f, u: vec3f, w: vec3f, scales: vec3f }

// With a = |u|^2 + low-pass, b = u w, D the determinant, t = dy - shear dx and shear = b / a,
//     alpha = opacity exp(-(a t^2 / D + dx^2 / a) / 2),   e = w - shear u = ((u x w) x u + low w) / a.
// A long needle's u and w are nearly parallel, and what depends on its length is a small difference of the gradients
// in u and in w. So they are computed in e, and as d_along = d_u + shear d_w, from which all large terms have dropped out.
// Lengths are in `unit`; share: what antialiasing leaves of the opacity, squared, 0 where there is none.
// (No product of two divisors is divided by, nor may a compiler make one: squares of them leave float32.)
fn screen_gradient(s: Shape, sums: Sums, low_pass: f32, share: f32) -> OnScreen {
    let a = s.a0 + s.low;
    let narrow = 1.0 / (a * s.unit);
    let sharp = 1.0 / s.determinant;
    let shear = s.b / a;
    let cross = across(s.u, s.w);
    let e = (across(cross, s.u) + s.low * s.w) / a;
    let wide = cross * s.unit;
    let xx = sums.wide.x * narrow * narrow;
    let xt = sums.wide.y * sharp;
    let tt = sums.high.x * sharp * sharp;
    let both = xt + shear * a * tt * low_pass;
    let long = xx - tt * (s.bare + low_pass * (dot(e, e) + shear * shear * s.low));
    var d_along = (long * s.u + both * e) / s.unit + a * tt * across(e, wide);
    var d_w = (both * s.u + a * tt * low_pass * e) / s.unit + a * tt * across(wide, s.u);
    if (share > 1e-12) { // the opacity's share is bare / determinant
        let half = 0.5 * sums.high.y * low_pass * sharp;
        let steep = 2.0 * half * (s.a0 + s.c0 + s.low) / s.bare;
        d_along += steep * across(e, wide) - 2.0 * half * (s.u + shear * s.w) / s.unit;
        d_w += steep * across(wide, s.u) - 2.0 * half * s.w / s.unit;
    }
    var d: OnScreen;
    let across_centre = a * sharp * sums.moments.y;
    d.centre = vec2f(sums.moments.x * narrow / s.unit - shear * across_centre, across_centre);
    d.u = d_along - shear * d_w;
    d.w = d_w;
    d.scales = (d_along * s.u + d_w * e) * s.unit;
    return d;
}

fn nothing(g: u32) {
    let n = view.counts.x;
    put(3u * g, vec3f(0.0));
    put(3u * (n + g), vec3f(0.0));
    for (var k = 0u; k < 4u; k++) {
        out[6u * n + 4u * g + k] = 0.0;
    }
    out[10u * n + g] = 0.0;
    for (var k = 0u; k < 3u * view.counts.y; k++) {
        out[11u * n + 3u * view.counts.y * g + k] = 0.0;
    }
    out[(11u + 3u * view.counts.y) * n + 2u * g] = 0.0;
    out[(11u + 3u * view.counts.y) * n + 2u * g + 1u] = 0.0;
}

fn chain(g: u32, thread: u32, sums: Sums, seen: View) {
    let n = view.counts.x;
    let kinds = view.counts.y;
    let s = shape_of(
        seen,
        vec3f(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]),
        vec3f(log_scales[3u * g], log_scales[3u * g + 1u], log_scales[3u * g + 2u]),
        vec4f(quaternions[4u * g], quaternions[4u * g + 1u], quaternions[4u * g + 2u], quaternions[4u * g + 3u]),
        opacity_logits[g],
    );

    put_one(10u * n + g, sums.high.y * s.rest);
    let d = screen_gradient(s, sums, view.frame.w, select(0.0, share_of(view, s), view.cutoff.z > 0.0));
    let screen = (11u + 3u * kinds) * n + 2u * g;
    put_one(screen, d.centre.x);
    put_one(screen + 1u, d.centre.y);

    // U = J V
    let rows = transpose(s.turned);
    let d_v0 = s.focal.x * d.u;
    let d_v1 = s.focal.y * d.w;
    let d_v2 = -(s.ratio.x * d_v0 + s.ratio.y * d_v1);
    let d_rx = select(0.0, -s.focal.x * dot(d.u, rows[2]), s.inside.x);
    let d_ry = select(0.0, -s.focal.y * dot(d.w, rows[2]), s.inside.y);
    let inverse_z = 1.0 / s.point.z;
    let d_x = s.focal.x * d.centre.x + d_rx * inverse_z;
    let d_y = s.focal.y * d.centre.y + d_ry * inverse_z;
    // (U is proportional to 1 / z at fixed ratios)
    let d_z = sums.far.y - inverse_z * (s.point.x * d_x + s.point.y * d_y + d.scales.x + d.scales.y + d.scales.z);
    let d_point = vec3f(d_x, d_y, d_z);

    // V = R M, M = Rq S
    let by_rows = transpose(mat3x3f(d_v0, d_v1, d_v2)); // columns: d V by column
    let world = mat3x3f(seen.rotation[0].xyz, seen.rotation[1].xyz, seen.rotation[2].xyz);
    let d_axes = world * by_rows;
    let d_turn = mat3x3f(d_axes[0] * s.scale.x, d_axes[1] * s.scale.y, d_axes[2] * s.scale.z);
    let given = vec3f(log_scales[3u * g], log_scales[3u * g + 1u], log_scales[3u * g + 2u]);
    put(3u * (n + g), select(vec3f(0.0), d.scales, abs(given) < vec3f(LOG_SCALE_LIMIT)));
    let d_q = quaternion_gradient(s.quaternion, d_turn) / max(s.length, 1.0) / s.largest;
    for (var k = 0u; k < 4u; k++) {
        put_one(6u * n + 4u * g + k, d_q[k]);
    }

    // colour
    let basis = harmonics(s.look);
    var lit = vec3f(0.5);
    for (var k = 0u; k < kinds; k++) {
        let at = 3u * (g * kinds + k);
        lit += basis[k] * vec3f(sh[at], sh[at + 1u], sh[at + 2u]);
    }
    // a colour below black is black whatever its coefficients
    let d_colour = select(vec3f(0.0), vec3f(sums.seen, sums.far.x), lit > vec3f(0.0));
    var weights: array<f32, 16>;
    for (var k = 0u; k < kinds; k++) {
        let at = 3u * (g * kinds + k);
        put(11u * n + at, d_colour * basis[k]);
        weights[k] = dot(d_colour, vec3f(sh[at], sh[at + 1u], sh[at + 2u]));
    }
    let gradient = harmonics_gradient(s.look, weights);
    let by_look = (gradient - dot(gradient, s.look) * s.look) / s.distance;
    put(3u * g, world * d_point + by_look);

    // pose: p = R m + t, seen from the centre; and the centre, of which every direction is the negative
    let by_axes = s.axes * mat3x3f(d_v0, d_v1, d_v2);
    for (var i = 0u; i < 3u; i++) {
        let row = by_axes[i] + d_point[i] * s.relative;
        for (var k = 0u; k < 3u; k++) {
            of_pose[(3u * i + k) * GROUP + thread] = row[k];
        }
        of_pose[(9u + i) * GROUP + thread] = d_point[i];
        of_pose[(12u + i) * GROUP + thread] = by_look[i];
    }
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let g = item(group, groups, thread, GROUP);
    for (var k = 0u; k < POSE_SUMS; k++) {
        of_pose[k * GROUP + thread] = 0.0;
    }
    let block = group.y * groups.x + group.x;
    for (var frame = 0u; frame < view.path.x; frame++) {
        let sums = sums_of(block, thread, frame);
        if (g < view.counts.x) {
            let range = ranges[frame * view.counts.x + g];
            if (range.x < range.y) {
                chain(g, thread, sums, view_from(frame));
            } else if (!adds) {
                nothing(g);
            }
            adds = true;
        }
    }
    workgroupBarrier();
    if (thread < POSE_SUMS && block * GROUP < view.counts.x) {
        var sum = 0.0;
        for (var t = 0u; t < GROUP; t++) {
            sum += of_pose[thread * GROUP + t];
        }
        pose[block * POSE_SUMS + thread] = sum;
    }
}
