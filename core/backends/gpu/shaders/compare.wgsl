// Truth values of tensors, one byte each: a thread makes four of them. What is not a number, or infinite, is seen by
// its bits: a compiler may take for granted that no number is.
// uses: operands
@group(0) @binding(4) var<storage, read_write> out: array<u32>;

fn result(x: f32, y: f32) -> bool {
    let bits = bitcast<u32>(x) & 0x7fffffffu;
    let numbers = bits <= 0x7f800000u && (bitcast<u32>(y) & 0x7fffffffu) <= 0x7f800000u;
    switch (params.operation) {
        case GREATER: { return x > y && numbers; }
        case LESS: { return x < y && numbers; }
        case GREATER_EQUAL: { return x >= y && numbers; }
        case LESS_EQUAL: { return x <= y && numbers; }
        case EQUAL: { return x == y && numbers; }
        case UNEQUAL: { return x != y || !numbers; }
        case BOTH: { return x != 0.0 && y != 0.0; }
        case EITHER: { return x != 0.0 || y != 0.0; }
        case NEITHER: { return x == 0.0 && y == 0.0; }
        case IS_NUMBER: { return bits <= 0x7f800000u; }
        default: { return bits != 0x7f800000u; } // NOT_INFINITE
    }
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let word = item(group, groups, thread, GROUP);
    var found = 0u;
    for (var byte = 0u; byte < 4u; byte++) {
        let i = 4u * word + byte;
        if (i < params.count && result(first_operand(i), second_operand(i))) {
            found |= 1u << (8u * byte);
        }
    }
    if (4u * word < params.count) {
        out[word] = found;
    }
}
