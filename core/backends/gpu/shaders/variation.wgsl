// Gradient of the joint variation of the three colours (`core.training.variation`), a thread for each pixel.
// uses: items
struct Params { width: u32, height: u32, epsilon: f32, fall: f32 } // epsilon: eps^2, fall: 1 / knee
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

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = item(group, groups, thread, GROUP);
    let plane = params.width * params.height;
    if (i >= plane) {
        return;
    }
    let x = i % params.width;
    let y = i / params.width;
    let here = slopes(x, y);
    var sum = -here.right;
    if (y + 1u < params.height) {
        sum -= here.down;
    }
    if (x > 0u) {
        sum += slopes(x - 1u, y).right;
    }
    if (y > 0u) {
        sum += slopes(x, y - 1u).down;
    }
    gradient[i] = sum.x;
    gradient[plane + i] = sum.y;
    gradient[2u * plane + i] = sum.z;
}
