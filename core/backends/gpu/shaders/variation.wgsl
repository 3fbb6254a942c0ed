// Gradient of the joint variation of the three colours (`core.training.variation`), a thread for each pixel; times a
// weight, and added to what stands there or alone.
// uses: block
struct Params {
    width: u32,
    height: u32,
    added: u32,
    epsilon: f32, // eps^2
    fall: f32,    // 1 / knee
    weight: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read_write> gradient: array<f32>;

fn at(x: u32, y: u32) -> vec3f {
    let plane = params.width * params.height;
    let i = y * params.width + x;
    return vec3f(image[i], image[plane + i], image[2u * plane + i]);
}

struct Slopes { right: vec3f, down: vec3f }

// Differences to the right and down, limited: grad / |grad| / (1 + |grad| / knee); none in the last column.
fn slopes(x: u32, y: u32) -> Slopes {
    var s: Slopes;
    if (x + 1u >= params.width) {
        return s;
    }
    let here = at(x, y);
    s.right = at(x + 1u, y) - here;
    s.down = at(x, min(y + 1u, params.height - 1u)) - here;
    let size = sqrt(dot(s.right, s.right) + dot(s.down, s.down) + params.epsilon);
    let scale = 1.0 / (size * (1.0 + size * params.fall));
    s.right *= scale;
    s.down *= scale;
    return s;
}

fn put(i: u32, value: f32) {
    gradient[i] = select(0.0, gradient[i], params.added == 1u) + params.weight * value;
}

@compute @workgroup_size(BLOCK_GROUP)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let p = pixel_of(group, thread);
    if (p.x >= params.width || p.y >= params.height) {
        return;
    }
    let here = slopes(p.x, p.y);
    var sum = -here.right;
    if (p.y + 1u < params.height) {
        sum -= here.down;
    }
    if (p.x > 0u) {
        sum += slopes(p.x - 1u, p.y).right;
    }
    if (p.y > 0u) {
        sum += slopes(p.x, p.y - 1u).down;
    }
    let plane = params.width * params.height;
    let i = p.y * params.width + p.x;
    put(i, sum.x);
    put(plane + i, sum.y);
    put(2u * plane + i, sum.z);
}
