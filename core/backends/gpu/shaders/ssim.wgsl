// SSIM and its derivatives by the windowed means of x, x^2 and x y; of each block how many values count, and their sums
// of SSIM and of |x - y|.
// uses: window
@group(0) @binding(4) var<storage, read_write> derivatives: array<f32>; // [3] of all planes
@group(0) @binding(5) var<storage, read_write> sums: array<vec4f>;

var<workgroup> shown: array<vec2f, REACHED>;
var<workgroup> means: array<vec2f, COLUMNS>; // along columns: of x and y, x^2 and y^2, x y
var<workgroup> squares: array<vec2f, COLUMNS>;
var<workgroup> products: array<f32, COLUMNS>;
var<workgroup> own: array<array<f32, BLOCK_GROUP>, 3>;

struct Moments {
    mean: vec2f,
    square: vec2f,
    product: f32,
}

fn shown_at(at: u32) -> Moments {
    let pair = shown[at];
    return Moments(pair, pair * pair, pair.x * pair.y);
}

fn column_at(at: u32) -> Moments {
    return Moments(means[at], squares[at], products[at]);
}

// sum + tap (one + other); in one form for all moments: of equal images, they are equal to the bit.
fn with_two(sum: Moments, tap: f32, one: Moments, other: Moments) -> Moments {
    return Moments(
        sum.mean + tap * (one.mean + other.mean),
        sum.square + tap * (one.square + other.square),
        sum.product + tap * (one.product + other.product),
    );
}

fn with_middle(tap: f32, one: Moments) -> Moments {
    return Moments(tap * one.mean, tap * one.square, tap * one.product);
}

fn sum_down(middle: u32) -> Moments {
    var sum = with_middle(WINDOW_TAP_0, shown_at(middle));
    sum = with_two(sum, WINDOW_TAP_{t}, shown_at(middle - {t}u * REACHED_WIDE), shown_at(middle + {t}u * REACHED_WIDE)); // each tap {t}
    return sum;
}

fn sum_across(middle: u32) -> Moments {
    var sum = with_middle(WINDOW_TAP_0, column_at(middle));
    sum = with_two(sum, WINDOW_TAP_{t}, column_at(middle - {t}u), column_at(middle + {t}u)); // each tap {t}
    return sum;
}

// SSIM, of windows around one px; writes its derivatives.
fn similarity(w: Moments, i: u32) -> f32 {
    let m = w.mean.x;
    let n = w.mean.y;
    let variance = max(w.square.x - m * m, 0.0);
    let other_variance = max(w.square.y - n * n, 0.0);
    // Rounding must not push the correlation of flat windows beyond 1 or -1.
    let highest = 0.5 * (variance + other_variance);
    let covariance = clamp(w.product - m * n, -highest, highest);
    let top_mean = 2.0 * m * n + SSIM_C1;
    let top_variance = 2.0 * covariance + SSIM_C2;
    let below_mean = m * m + n * n + SSIM_C1;
    let below_variance = variance + other_variance + SSIM_C2;
    let inverse = 1.0 / (below_mean * below_variance);
    let value = top_mean * top_variance * inverse;
    let by_mean = value * below_variance * inverse;
    let by_variance = value * below_mean * inverse;
    derivatives[i] = 2.0 * (n * (top_variance - top_mean) * inverse + m * (by_variance - by_mean));
    derivatives[params.count + i] = -by_variance;
    derivatives[2u * params.count + i] = 2.0 * top_mean * inverse;
    return value;
}

fn nothing(i: u32) {
    derivatives[i] = 0.0;
    derivatives[params.count + i] = 0.0;
    derivatives[2u * params.count + i] = 0.0;
}

fn add_up(thread: u32, half: u32) {
    own[0][thread] += own[0][thread + half];
    own[1][thread] += own[1][thread + half];
    own[2][thread] += own[2][thread + half];
}

@compute @workgroup_size(BLOCK_GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = block_of(group);
    for (var k = thread; k < REACHED; k += BLOCK_GROUP) {
        let at = place_at(block, k % REACHED_WIDE, k / REACHED_WIDE);
        var pair = vec2f(0.0);
        if (at.inside) {
            pair = pair_at(at);
        }
        shown[k] = pair;
    }
    workgroupBarrier();
    for (var k = thread; k < COLUMNS; k += BLOCK_GROUP) {
        let sum = sum_down(k + WINDOW_REACH * REACHED_WIDE);
        means[k] = sum.mean;
        squares[k] = sum.square;
        products[k] = sum.product;
    }
    workgroupBarrier();
    let column = thread % BLOCK_WIDE + WINDOW_REACH;
    let row = thread / BLOCK_WIDE;
    let at = place_at(block, column, row + WINDOW_REACH);
    own[0][thread] = 0.0;
    own[1][thread] = 0.0;
    own[2][thread] = 0.0;
    if (at.inside) {
        if (counts(at)) {
            let pair = shown[(row + WINDOW_REACH) * REACHED_WIDE + column];
            own[0][thread] = 1.0;
            own[1][thread] = similarity(sum_across(row * REACHED_WIDE + column), at.i);
            own[2][thread] = abs(pair.x - pair.y);
        } else {
            nothing(at.i);
        }
    }
    for (var half = BLOCK_GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (thread < half) {
            add_up(thread, half);
        }
    }
    if (thread == 0u) {
        sums[group.y * groups.x + group.x] = vec4f(own[0][0], own[1][0], own[2][0], 0.0);
    }
}
