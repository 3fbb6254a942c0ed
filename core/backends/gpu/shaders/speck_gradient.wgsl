// Gradient of the price of specks, from its derivatives by the structure tensor.
// uses: differences
@group(0) @binding(2) var<storage, read> slants: array<f32>;
@group(0) @binding(3) var<storage, read_write> gradient: array<f32>;

struct Flow { right: vec3f, down: vec3f }

// Derivatives by the differences of one px to the right and down.
fn flow(x: u32, y: u32) -> Flow {
    var found: Flow;
    if (!has_differences(x, y)) {
        return found;
    }
    let plane = params.width * params.height;
    let i = y * params.width + x;
    let right = at(i + 1u) - at(i);
    let down = at(i + params.width) - at(i);
    let slant = vec3f(slants[i], slants[plane + i], slants[2u * plane + i]);
    found.right = 2.0 * slant.x * right + slant.z * down;
    found.down = 2.0 * slant.y * down + slant.z * right;
    return found;
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
    let here = flow(x, y);
    var sum = -here.right - here.down;
    if (x > 0u) {
        sum += flow(x - 1u, y).right;
    }
    if (y > 0u) {
        sum += flow(x, y - 1u).down;
    }
    gradient[i] = sum.x;
    gradient[plane + i] = sum.y;
    gradient[2u * plane + i] = sum.z;
}
