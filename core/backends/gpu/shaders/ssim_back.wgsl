// The windows taken back: the gradient of the loss, from SSIM's derivatives by windowed means.
// uses: window
@group(0) @binding(4) var<storage, read> derivatives: array<f32>;
@group(0) @binding(5) var<storage, read> totals: array<vec4f>; // the first number: how many values count
@group(0) @binding(6) var<storage, read_write> gradient: array<f32>;

var<workgroup> near: array<array<f32, REACHED>, 3>;
var<workgroup> columns: array<array<f32, COLUMNS>, 3>;

fn near_at(at: u32) -> vec3f {
    return vec3f(near[0][at], near[1][at], near[2][at]);
}

fn column_at(at: u32) -> vec3f {
    return vec3f(columns[0][at], columns[1][at], columns[2][at]);
}

fn sum_down(middle: u32) -> vec3f {
    var sum = WINDOW_TAP_0 * near_at(middle);
    sum += WINDOW_TAP_{t} * (near_at(middle - {t}u * REACHED_WIDE) + near_at(middle + {t}u * REACHED_WIDE)); // each tap {t}
    return sum;
}

fn sum_across(middle: u32) -> vec3f {
    var sum = WINDOW_TAP_0 * column_at(middle);
    sum += WINDOW_TAP_{t} * (column_at(middle - {t}u) + column_at(middle + {t}u)); // each tap {t}
    return sum;
}

@compute @workgroup_size(BLOCK_GROUP)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let block = block_of(group);
    for (var k = thread; k < REACHED; k += BLOCK_GROUP) {
        let at = place_at(block, k % REACHED_WIDE, k / REACHED_WIDE);
        var found = vec3f(0.0);
        if (at.inside) {
            found = vec3f(derivatives[at.i], derivatives[params.count + at.i], derivatives[2u * params.count + at.i]);
        }
        near[0][k] = found.x;
        near[1][k] = found.y;
        near[2][k] = found.z;
    }
    workgroupBarrier();
    for (var k = thread; k < COLUMNS; k += BLOCK_GROUP) {
        let sum = sum_down(k + WINDOW_REACH * REACHED_WIDE);
        columns[0][k] = sum.x;
        columns[1][k] = sum.y;
        columns[2][k] = sum.z;
    }
    workgroupBarrier();
    let column = thread % BLOCK_WIDE + WINDOW_REACH;
    let row = thread / BLOCK_WIDE;
    let at = place_at(block, column, row + WINDOW_REACH);
    if (!at.inside) {
        return;
    }
    var slope = 0.0;
    if (counts(at)) {
        let w = sum_across(row * REACHED_WIDE + column);
        let x = image[at.i];
        let y = photo[at.i];
        let structure = w.x + 2.0 * x * w.y + y * w.z;
        slope = params.error_weight * sign(x - y) - params.structure_weight * structure;
    }
    gradient[at.i] = slope / max(totals[0].x, 1.0);
}
