// Spectra of three colours, filtered in place: each times one transfer function, and their sum times another one added
// to each. A transfer function is real or complex.
// uses: items, complex
struct Params {
    count: u32, // of one colour
    own_complex: u32,
    shared_complex: u32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> own: array<f32>;
@group(0) @binding(2) var<storage, read> shared_part: array<f32>;
@group(0) @binding(3) var<storage, read_write> spectra: array<vec2f>;

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
    var by = vec2f(0.0);
    if (params.own_complex == 1u) {
        by = vec2f(own[2u * i], own[2u * i + 1u]);
    } else {
        by = vec2f(own[i], 0.0);
    }
    var by_shared = vec2f(0.0);
    if (params.shared_complex == 1u) {
        by_shared = vec2f(shared_part[2u * i], shared_part[2u * i + 1u]);
    } else {
        by_shared = vec2f(shared_part[i], 0.0);
    }
    let red = spectra[i];
    let green = spectra[params.count + i];
    let blue = spectra[2u * params.count + i];
    let added = product(red + green + blue, by_shared);
    spectra[i] = product(red, by) + added;
    spectra[params.count + i] = product(green, by) + added;
    spectra[2u * params.count + i] = product(blue, by) + added;
}
