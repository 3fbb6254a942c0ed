// Gradient of the price of specks (`core.training.specks`) on a block of px: the structure tensor, the derivatives of
// its averaged smaller eigenvalue, and the average taken back, all in the group's memory; times a weight, and added to
// what stands there or alone.
// uses: block
struct Params {
    width: u32,
    height: u32,
    added: u32,
    weight: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read_write> gradient: array<f32>;

// Three fields of a block, each with as many px around it as those that come from it need.
const TENSOR_WIDE = BLOCK_WIDE + 5u;
const SLANTS_WIDE = BLOCK_WIDE + 3u;
const MEANS_WIDE = BLOCK_WIDE + 1u;
const TENSOR = TENSOR_WIDE * (BLOCK_HIGH + 5u); // px of each
const SLANTS = SLANTS_WIDE * (BLOCK_HIGH + 3u);
const MEANS = MEANS_WIDE * (BLOCK_HIGH + 1u);

var<workgroup> fields: array<array<f32, TENSOR + SLANTS + MEANS>, 3>;

fn field_at(at: u32) -> vec3f {
    return vec3f(fields[0][at], fields[1][at], fields[2][at]);
}

fn put_field(at: u32, value: vec3f) {
    fields[0][at] = value.x;
    fields[1][at] = value.y;
    fields[2][at] = value.z;
}

fn row_mean(at: u32) -> vec3f {
    return 0.25 * (field_at(at - 1u) + field_at(at + 1u)) + 0.5 * field_at(at);
}

fn mean_around(at: u32, wide: u32) -> vec3f { // binomial; it is its own transpose
    return 0.25 * (row_mean(at - wide) + row_mean(at + wide)) + 0.5 * row_mean(at);
}

fn in_frame(p: vec2u) -> bool { // (what lies left of the frame or above it wraps around)
    return p.x < params.width && p.y < params.height;
}

fn colours(i: u32) -> vec3f {
    let plane = params.width * params.height;
    return vec3f(image[i], image[plane + i], image[2u * plane + i]);
}

struct Differences { right: vec3f, down: vec3f }

// To the px on the right and below; none in the last row and the last column.
fn differences(p: vec2u) -> Differences {
    var found: Differences;
    if (in_frame(p) && in_frame(p + 1u)) {
        let i = p.y * params.width + p.x;
        let here = colours(i);
        found.right = colours(i + 1u) - here;
        found.down = colours(i + params.width) - here;
    }
    return found;
}

fn tensor(p: vec2u) -> vec3f { // |right|^2, |down|^2, right . down of all colours
    let d = differences(p);
    return vec3f(dot(d.right, d.right), dot(d.down, d.down), dot(d.right, d.down));
}

// Derivatives of sqrt(l2 + eps^2), l2 the smaller eigenvalue of the averaged structure tensor, by its three entries.
fn slants(mean: vec3f) -> vec3f {
    let half = 0.5 * (mean.x - mean.y);
    let spread = sqrt(half * half + mean.z * mean.z + SMOOTH_SQUARED * SMOOTH_SQUARED);
    let low = 0.5 * (mean.x + mean.y) - spread;
    if (low <= 0.0) {
        return vec3f(0.0);
    }
    let scale = 0.5 / sqrt(low + SMOOTH_SQUARED);
    let turn = 0.5 * half / spread;
    return scale * vec3f(0.5 - turn, 0.5 + turn, -mean.z / spread);
}

struct Flow { right: vec3f, down: vec3f }

// Derivatives by the differences of one px, from those by the structure tensor.
fn flow(p: vec2u, at: u32) -> Flow {
    let d = differences(p);
    let slant = field_at(at);
    return Flow(2.0 * slant.x * d.right + slant.z * d.down, 2.0 * slant.y * d.down + slant.z * d.right);
}

fn put(i: u32, value: f32) {
    gradient[i] = select(0.0, gradient[i], params.added == 1u) + params.weight * value;
}

@compute @workgroup_size(BLOCK_GROUP)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let corner = group.xy * vec2u(BLOCK_WIDE, BLOCK_HIGH);
    for (var k = thread; k < TENSOR; k += BLOCK_GROUP) {
        put_field(k, tensor(corner + vec2u(k % TENSOR_WIDE, k / TENSOR_WIDE) - 3u));
    }
    workgroupBarrier();
    for (var k = thread; k < SLANTS; k += BLOCK_GROUP) {
        let at = vec2u(k % SLANTS_WIDE, k / SLANTS_WIDE);
        var found = vec3f(0.0);
        if (in_frame(corner + at - 2u)) {
            found = slants(mean_around((at.y + 1u) * TENSOR_WIDE + at.x + 1u, TENSOR_WIDE));
        }
        put_field(TENSOR + k, found);
    }
    workgroupBarrier();
    for (var k = thread; k < MEANS; k += BLOCK_GROUP) {
        let at = TENSOR + (k / MEANS_WIDE + 1u) * SLANTS_WIDE + k % MEANS_WIDE + 1u;
        put_field(TENSOR + SLANTS + k, mean_around(at, SLANTS_WIDE));
    }
    workgroupBarrier();
    let p = pixel_of(group, thread);
    if (!in_frame(p)) {
        return;
    }
    let here = TENSOR + SLANTS + (thread / BLOCK_WIDE + 1u) * MEANS_WIDE + thread % BLOCK_WIDE + 1u;
    let own = flow(p, here);
    let left = flow(p - vec2u(1u, 0u), here - 1u); // (none from beyond the frame: no differences there)
    let above = flow(p - vec2u(0u, 1u), here - MEANS_WIDE);
    let sum = left.right + above.down - own.right - own.down;
    let plane = params.width * params.height;
    let i = p.y * params.width + p.x;
    put(i, sum.x);
    put(plane + i, sum.y);
    put(2u * plane + i, sum.z);
}
