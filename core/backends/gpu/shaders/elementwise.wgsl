// One operation of tensors, value by value, into a tensor at steps of its own; IN_PLACE: that is the first operand.
// uses: operands
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

fn power(x: f32, exponent: f32) -> f32 { // (of x >= 0; as torch's it is 1 where the exponent is 0)
    return select(pow(x, exponent), 0.0, x == 0.0 && exponent > 0.0);
}

fn result(x: f32, y: f32, i: u32) -> f32 {
    let p = params.numbers.z;
    let q = params.numbers.w;
    switch (params.operation) {
        case SUM: { return x + p * y; }
        case PRODUCT: { return x * y; }
        case QUOTIENT: { return x / y; }
        case LARGER: { return max(x, y); }
        case SMALLER: { return min(x, y); }
        case LIMITED: { return clamp(x, p, q); }
        case POWER: { return power(x, p); }
        case ROOT: { return sqrt(x); }
        case SIZE: { return abs(x); }
        case SIGN: { return sign(x); }
        case EXPONENTIAL: { return exp(x); }
        case LOGISTIC: { return 1.0 / (1.0 + exp(-x)); }
        case WHERE: { return select(y, x, holds(i)); }
        default: { return x; }
    }
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = item(group, groups, thread, GROUP);
    if (i >= params.count) {
        return;
    }
    let to = place(i, params.out_steps, params.offsets.w);
    var x: f32;
    if ((params.flags & IN_PLACE) != 0u) {
        x = out[to];
    } else {
        x = first_operand(i);
    }
    out[to] = result(x, second_operand(i), i);
}
