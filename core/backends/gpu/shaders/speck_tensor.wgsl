// The structure tensor before its mean (`core.training.specks`): |right|^2, |down|^2, right . down of all colours.
// uses: differences
@group(0) @binding(2) var<storage, read_write> tensor: array<f32>;

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
    var found = vec3f(0.0);
    if (has_differences(i % params.width, i / params.width)) {
        let right = at(i + 1u) - at(i);
        let down = at(i + params.width) - at(i);
        found = vec3f(dot(right, right), dot(down, down), dot(right, down));
    }
    tensor[i] = found.x;
    tensor[plane + i] = found.y;
    tensor[2u * plane + i] = found.z;
}
