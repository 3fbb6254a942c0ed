// What operations on tensors read: up to three tensors of up to four axes, each at steps of its own, or plain numbers.
// Truth values are bytes, four to a word.
// uses: items
struct Params {
    sizes: vec4u,
    a_steps: vec4u,
    b_steps: vec4u,
    c_steps: vec4u,
    out_steps: vec4u,
    offsets: vec4u,  // of a, b, c and the result
    numbers: vec4f,  // a and b where they are no tensors; two of the operation
    count: u32,
    operation: u32,
    flags: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> a: array<u32>;
@group(0) @binding(2) var<storage, read> b: array<u32>;
@group(0) @binding(3) var<storage, read> c: array<u32>;

fn place(item: u32, steps: vec4u, offset: u32) -> u32 {
    let s = params.sizes;
    let last = item / s.w;
    let third = last / s.z;
    let at = vec4u(third / s.y, third % s.y, last % s.z, item % s.w);
    return offset + at.x * steps.x + at.y * steps.y + at.z * steps.z + at.w * steps.w;
}

fn byte_of(word: u32, at: u32) -> f32 {
    return f32((word >> (8u * (at & 3u))) & 0xffu);
}

fn first_operand(i: u32) -> f32 {
    if ((params.flags & A_NUMBER) != 0u) {
        return params.numbers.x;
    }
    let at = place(i, params.a_steps, params.offsets.x);
    if ((params.flags & A_BYTES) != 0u) {
        return byte_of(a[at / 4u], at);
    }
    return bitcast<f32>(a[at]);
}

fn second_operand(i: u32) -> f32 {
    if ((params.flags & B_NUMBER) != 0u) {
        return params.numbers.y;
    }
    let at = place(i, params.b_steps, params.offsets.y);
    if ((params.flags & B_BYTES) != 0u) {
        return byte_of(b[at / 4u], at);
    }
    return bitcast<f32>(b[at]);
}

fn holds(i: u32) -> bool { // the condition of WHERE
    let at = place(i, params.c_steps, params.offsets.z);
    return byte_of(c[at / 4u], at) != 0.0;
}
