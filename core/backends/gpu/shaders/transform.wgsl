// One pass of Stockham's Fourier transform along one axis (radix up to 5; Govindaraju et al. 2008, "High performance
// discrete Fourier transforms on graphics processors"): its input is complex, real, or the first half of a spectrum
// whose rest are conjugates; so is its output.
// uses: items, complex
struct Params {
    length: u32,
    radix: u32,
    done: u32,         // product of the radices of earlier passes
    inner: u32,        // values between two of the axis; lines that lie side by side
    count: u32,        // butterflies
    source_pitch: u32, // values between two groups of `inner` lines
    target_pitch: u32,
    source_kind: u32,
    target_kind: u32,
    inverse: u32,
    scale: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> turns: array<vec2f>; // exp(-2 pi i k / length)
@group(0) @binding(2) var<storage, read> source: array<f32>;
@group(0) @binding(3) var<storage, read_write> out: array<f32>;

fn turn(k: u32) -> vec2f {
    let t = turns[k];
    return vec2f(t.x, select(t.y, -t.y, params.inverse == 1u));
}

fn input_at(base: u32, k: u32) -> vec2f {
    if (params.source_kind == REAL) {
        return vec2f(source[base + k * params.inner], 0.0);
    }
    let mirrored = params.source_kind == HALF && k > params.length / 2u;
    let at = 2u * (base + select(k, params.length - k, mirrored) * params.inner);
    return vec2f(source[at], select(source[at + 1u], -source[at + 1u], mirrored));
}

fn output_at(base: u32, k: u32, value: vec2f) {
    let at = base + k * params.inner;
    if (params.target_kind == REAL) {
        out[at] = params.scale * value.x;
    } else if (params.target_kind == WHOLE || k <= params.length / 2u) {
        out[2u * at] = params.scale * value.x;
        out[2u * at + 1u] = params.scale * value.y;
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
    let radix = params.radix;
    let apart = params.length / radix;
    let line = i % params.inner;
    let rest = i / params.inner;
    let j = rest % apart;
    let outer = rest / apart;
    let k = j % params.done;
    let step = apart / params.done;
    var values: array<vec2f, LARGEST_RADIX>;
    var roots: array<vec2f, LARGEST_RADIX>;
    for (var p = 0u; p < radix; p++) {
        values[p] = product(input_at(outer * params.source_pitch + line, j + p * apart), turn(p * k * step));
        roots[p] = turn(p * apart);
    }
    let first = (j / params.done) * params.done * radix + k;
    for (var q = 0u; q < radix; q++) {
        var sum = values[0];
        for (var p = 1u; p < radix; p++) {
            sum += product(values[p], roots[(p * q) % radix]);
        }
        output_at(outer * params.target_pitch + line, first + q * params.done, sum);
    }
}
