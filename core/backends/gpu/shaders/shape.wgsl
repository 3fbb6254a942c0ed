// A Gaussian's shape on the screen (Zwicker's EWA), for the forward and the backward pass.
// uses: view

// Lengths on the screen are in units of the splat's own size, at least 1 px: so no covariance overflows.
struct Shape {
    relative: vec3f,  // from the camera's centre, in the world's axes
    point: vec3f,     // in camera coordinates
    quaternion: vec4f, // w x y z, of length 1
    length: f32,      // of the given quaternion, divided by `largest`: from 1 to 2, 0 where it has none
    largest: f32,
    scale: vec3f,
    axes: mat3x3f,    // the Gaussian's axes, each times its scale
    turned: mat3x3f,  // the same in camera coordinates
    ratio: vec2f,     // x / z and y / z where the Jacobian is taken
    inside: vec2<bool>,
    focal: vec2f,     // over z
    unit: f32,        // px
    u: vec3f,         // rows of J V, in `unit`
    w: vec3f,
    a0: f32,          // covariance without the low-pass, in unit^2
    b: f32,
    c0: f32,
    low: f32,         // the low-pass in unit^2
    bare: f32,        // determinants over unit^2 px^2: without and with the low-pass
    determinant: f32,
    opacity: f32,     // without antialiasing
    rest: f32,        // 1 - opacity, with all its digits
    look: vec3f,      // unit vector along which the camera sees it
    distance: f32,
}

// a d - b c, with what the products' rounding takes away
fn difference_of_products(a: f32, d: f32, b: f32, c: f32) -> f32 {
    let product = b * c;
    return fma(a, d, -product) + fma(-b, c, product);
}

fn across(u: vec3f, w: vec3f) -> vec3f {
    return vec3f(
        difference_of_products(u.y, w.z, u.z, w.y),
        difference_of_products(u.z, w.x, u.x, w.z),
        difference_of_products(u.x, w.y, u.y, w.x),
    );
}

fn largest_of(v: vec3f) -> f32 {
    return max(max(abs(v.x), abs(v.y)), abs(v.z));
}

// What a vector and its largest component are multiplied by, exactly, before the one is divided by the other: cards
// divide by way of the reciprocal, which is flushed to zero where the divisor is beyond 2^126.
fn tamed(largest: f32) -> f32 {
    return select(1.0, 0x1p-64, largest > 0x1p+64);
}

// Rotation matrix of a unit quaternion w x y z, by columns.
fn rotation_of(q: vec4f) -> mat3x3f {
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    return mat3x3f(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
        2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
        2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y),
    );
}

fn shape_of(view: View, mean: vec3f, log_scale: vec3f, quaternion: vec4f, logit: f32) -> Shape {
    var s: Shape;
    let centre = vec3f(view.rotation[0].w, view.rotation[1].w, view.rotation[2].w);
    s.relative = (mean - centre) - view.centre_rest.xyz;
    s.point = vec3f(
        dot(view.rotation[0].xyz, s.relative),
        dot(view.rotation[1].xyz, s.relative),
        dot(view.rotation[2].xyz, s.relative),
    );
    s.largest = max(largest_of(quaternion.xyz), abs(quaternion.w));
    let tame = tamed(s.largest);
    let direction = (tame * quaternion) / max(tame * s.largest, 1e-30);
    s.length = sqrt(dot(direction, direction));
    s.quaternion = direction / max(s.length, 1e-30);
    s.scale = exp(clamp(log_scale, vec3f(-LOG_SCALE_LIMIT), vec3f(LOG_SCALE_LIMIT)));
    let turn = rotation_of(s.quaternion);
    s.axes = mat3x3f(turn[0] * s.scale.x, turn[1] * s.scale.y, turn[2] * s.scale.z);
    let to_camera = transpose(mat3x3f(view.rotation[0].xyz, view.rotation[1].xyz, view.rotation[2].xyz));
    s.turned = to_camera * s.axes;

    s.focal = view.lens.xy / s.point.z;
    let straight = s.point.xy / s.point.z;
    s.ratio = clamp(straight, view.limits.xz, view.limits.yw);
    s.inside = s.ratio == straight;
    let rows = transpose(s.turned);
    let u = s.focal.x * (rows[0] - s.ratio.x * rows[2]);
    let w = s.focal.y * (rows[1] - s.ratio.y * rows[2]);
    s.unit = max(max(largest_of(u), largest_of(w)), 1.0);
    s.u = u / s.unit;
    s.w = w / s.unit;

    // det(U U^T) = |u x w|^2 (Cauchy-Binet): exact for needles, where a c - b b cancels
    let cross = across(s.u, s.w) * s.unit;
    s.bare = dot(cross, cross);
    s.a0 = dot(s.u, s.u);
    s.b = dot(s.u, s.w);
    s.c0 = dot(s.w, s.w);
    s.low = view.frame.w / s.unit / s.unit;
    s.determinant = s.bare + view.frame.w * (s.a0 + s.c0) + view.frame.w * s.low;

    let bounded = clamp(logit, -80.0, 80.0); // beyond, exp leaves float32
    s.opacity = 1.0 / (1.0 + exp(-bounded));
    s.rest = 1.0 / (1.0 + exp(bounded));

    let far = max(largest_of(s.relative), 1e-30);
    let away = (tamed(far) * s.relative) / (tamed(far) * far);
    let long = sqrt(dot(away, away));
    s.look = away / max(long, 1e-30);
    s.distance = far * long;
    return s;
}

// What antialiasing leaves of the opacity, squared.
fn share_of(view: View, s: Shape) -> f32 {
    return select(1.0, s.bare / s.determinant, view.cutoff.z > 0.0);
}
