// What density control adds up of a view: the length of every Gaussian's gradient in its projected centre, and whether
// the view saw it.
// uses: items
struct Params { count: u32, first: u32 } // `first`: where the gradients begin in their memory
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> centres: array<f32>;
@group(0) @binding(2) var<storage, read> radii: array<f32>;
@group(0) @binding(3) var<storage, read_write> gradients: array<f32>;
@group(0) @binding(4) var<storage, read_write> views: array<f32>;

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
    let at = params.first + 2u * i;
    gradients[i] += length(vec2f(centres[at], centres[at + 1u]));
    views[i] += select(0.0, 1.0, radii[i] > 0.0);
}
