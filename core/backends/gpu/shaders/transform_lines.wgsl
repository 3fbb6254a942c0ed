// Stockham's Fourier transform of whole lines along one axis in the group's memory (radix up to 5; see `transform`):
// what it reads is complex, real, or the first half of a spectrum whose rest are conjugates; so is what it writes. All
// butterflies of a pass are held in registers before the first of them is written: there is memory for the lines once.
// LENGTH, LINES (of a group) and all_passes are written for each length (`radices.py`).
// uses: items, complex
struct Params {
    inner: u32,        // values between two of the axis; lines that lie side by side
    count: u32,        // lines of all groups
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

var<workgroup> values: array<vec2f, LINE_VALUES>;

const COS_72 = 0.30901699437494745;
const SIN_72 = 0.9510565162951535;
const COS_144 = -0.8090169943749475;
const SIN_144 = 0.5877852522924731;
const SIN_60 = 0.8660254037844386;

// A pass over all lines: its radix, the product of those before it, and butterflies of one line.
struct Pass {
    first_line: u32,
    radix: u32,
    done: u32,
    apart: u32,
}

// One butterfly of a pass: its line among those of the group, and its place there.
struct Place {
    within: bool,
    line: u32,
    j: u32,
}

struct Five {
    a: vec2f,
    b: vec2f,
    c: vec2f,
    d: vec2f,
    e: vec2f,
}

fn place_of(now: Pass, number: u32) -> Place {
    var place: Place;
    if (params.inner == 1u) { // threads side by side take values that lie side by side
        place.line = number / now.apart;
        place.j = number % now.apart;
    } else {
        place.line = number % LINES;
        place.j = number / LINES;
    }
    place.within = number < LINES * now.apart && now.first_line + place.line < params.count;
    return place;
}

fn in_group(line: u32, k: u32) -> u32 {
    return select(k * LINES + line, line * LENGTH + k, params.inner == 1u);
}

// Where a line begins, of lines with this pitch.
fn base_of(line: u32, pitch: u32) -> u32 {
    return (line / params.inner) * pitch + line % params.inner;
}

fn turn(k: u32) -> vec2f {
    let t = turns[k];
    return vec2f(t.x, select(t.y, -t.y, params.inverse == 1u));
}

fn quarter(x: vec2f) -> vec2f { // times -i; i of an inverse
    return select(vec2f(x.y, -x.x), vec2f(-x.y, x.x), params.inverse == 1u);
}

fn input_at(base: u32, k: u32) -> vec2f {
    if (params.source_kind == REAL) {
        return vec2f(source[base + k * params.inner], 0.0);
    }
    let mirrored = params.source_kind == HALF && k > LENGTH / 2u;
    let at = 2u * (base + select(k, LENGTH - k, mirrored) * params.inner);
    return vec2f(source[at], select(source[at + 1u], -source[at + 1u], mirrored));
}

fn output_at(base: u32, k: u32, value: vec2f) {
    let at = base + k * params.inner;
    if (params.target_kind == REAL) {
        out[at] = params.scale * value.x;
    } else if (params.target_kind == WHOLE || k <= LENGTH / 2u) {
        out[2u * at] = params.scale * value.x;
        out[2u * at + 1u] = params.scale * value.y;
    }
}

// The value number p of a butterfly, turned.
fn taken(now: Pass, place: Place, p: u32) -> vec2f {
    let k = place.j + p * now.apart;
    if (now.done == 1u) {
        return input_at(base_of(now.first_line + place.line, params.source_pitch), k);
    }
    let by = turn(p * (place.j % now.done) * (now.apart / now.done));
    return product(values[in_group(place.line, k)], by);
}

fn two(x: Five) -> Five {
    return Five(x.a + x.b, x.a - x.b, x.c, x.d, x.e);
}

fn three(x: Five) -> Five {
    let sum = x.b + x.c;
    let middle = x.a - 0.5 * sum;
    let across = SIN_60 * quarter(x.b - x.c);
    return Five(x.a + sum, middle + across, middle - across, x.d, x.e);
}

fn four(x: Five) -> Five {
    let across = quarter(x.b - x.d);
    let even = x.a + x.c;
    let odd = x.a - x.c;
    return Five(even + (x.b + x.d), odd + across, even - (x.b + x.d), odd - across, x.e);
}

fn five(x: Five) -> Five {
    let near = x.b + x.e;
    let far = x.c + x.d;
    let first = x.a + COS_72 * near + COS_144 * far;
    let second = x.a + COS_144 * near + COS_72 * far;
    let first_across = quarter(SIN_72 * (x.b - x.e) + SIN_144 * (x.c - x.d));
    let second_across = quarter(SIN_144 * (x.b - x.e) - SIN_72 * (x.c - x.d));
    let whole = x.a + near + far;
    return Five(whole, first + first_across, second + second_across, second - second_across, first - first_across);
}

fn butterfly(now: Pass, number: u32) -> Five {
    var x: Five;
    let place = place_of(now, number);
    if (!place.within) {
        return x;
    }
    x.a = taken(now, place, 0u);
    if (now.radix > 1u) {
        x.b = taken(now, place, 1u);
    }
    if (now.radix > 2u) {
        x.c = taken(now, place, 2u);
    }
    if (now.radix > 3u) {
        x.d = taken(now, place, 3u);
    }
    if (now.radix > 4u) {
        x.e = taken(now, place, 4u);
    }
    switch (now.radix) {
        case 2u: { return two(x); }
        case 3u: { return three(x); }
        case 4u: { return four(x); }
        case 5u: { return five(x); }
        default: { return x; }
    }
}

fn put_one(now: Pass, place: Place, k: u32, value: vec2f) {
    if (now.done * now.radix == LENGTH) {
        output_at(base_of(now.first_line + place.line, params.target_pitch), k, value);
    } else {
        values[in_group(place.line, k)] = value;
    }
}

fn put(now: Pass, number: u32, x: Five) {
    let place = place_of(now, number);
    if (!place.within) {
        return;
    }
    let k = place.j % now.done;
    let first = (place.j - k) * now.radix + k;
    put_one(now, place, first, x.a);
    if (now.radix > 1u) {
        put_one(now, place, first + now.done, x.b);
    }
    if (now.radix > 2u) {
        put_one(now, place, first + 2u * now.done, x.c);
    }
    if (now.radix > 3u) {
        put_one(now, place, first + 3u * now.done, x.d);
    }
    if (now.radix > 4u) {
        put_one(now, place, first + 4u * now.done, x.e);
    }
}

@compute @workgroup_size(LINE_GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    all_passes(item(group, groups, 0u, LINES), thread);
}
