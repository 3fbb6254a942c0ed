// Adds what one photo sees of each Gaussian: its contribution, the share of its bare footprint that this is, and whether
// its centre lies in the frame (`core.training.contribution`).
// uses: items, shape
const TWO_PI = 6.283185307179586;
struct Params { view: View, first: u32 } // `first`: where the gradients begin in their memory
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> log_scales: array<f32>;
@group(0) @binding(3) var<storage, read> quaternions: array<f32>;
@group(0) @binding(4) var<storage, read> opacity_logits: array<f32>;
@group(0) @binding(5) var<storage, read> gradients: array<f32>;
@group(0) @binding(6) var<storage, read_write> contribution: array<f32>;
@group(0) @binding(7) var<storage, read_write> visibility: array<f32>;
@group(0) @binding(8) var<storage, read_write> framed: array<f32>;

// Px that a Gaussian would cover with nothing before it, at most the frame's; 0 where its centre lies outside.
fn bare_footprint(view: View, s: Shape) -> f32 {
    if (!(s.point.z > view.frame.z)) {
        return 0.0;
    }
    let place = view.lens.xy * s.point.xy / s.point.z + view.lens.zw;
    if (!(all(place > vec2f(0.0)) && all(place < view.frame.xy))) {
        return 0.0;
    }
    let area = TWO_PI * s.opacity * sqrt(share_of(view, s)) * sqrt(s.determinant) * s.unit;
    return select(0.0, min(area, view.frame.x * view.frame.y), is_finite(area));
}

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let g = item(group, groups, thread, GROUP);
    if (g >= params.view.counts.x) {
        return;
    }
    let s = shape_of(
        params.view,
        vec3f(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]),
        vec3f(log_scales[3u * g], log_scales[3u * g + 1u], log_scales[3u * g + 2u]),
        vec4f(quaternions[4u * g], quaternions[4u * g + 1u], quaternions[4u * g + 2u], quaternions[4u * g + 3u]),
        opacity_logits[g],
    );
    let bare = bare_footprint(params.view, s);
    let blended = gradients[params.first + 3u * g] / SH_C0;
    contribution[g] += blended;
    if (bare > 0.0) {
        visibility[g] += blended / max(bare, LEAST_FOOTPRINT);
        framed[g] += 1.0;
    }
}
