// Checks every Gaussian's parameters: makes it as large as its distance from the nearest camera lets it be, and counts
// who was larger, whose scale the projection clamps, and who has a parameter that is not finite.
// uses: items, view
struct Params { count: u32, harmonics: u32, centres: u32, largest: f32 } // `largest`: of the distance
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read_write> log_scales: array<f32>;
@group(0) @binding(3) var<storage, read> quaternions: array<f32>;
@group(0) @binding(4) var<storage, read> opacity_logits: array<f32>;
@group(0) @binding(5) var<storage, read> sh: array<f32>;
@group(0) @binding(6) var<storage, read> centres: array<f32>;
@group(0) @binding(7) var<storage, read_write> found: array<atomic<u32>>; // limited, clamped, not finite

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let g = item(group, groups, thread, GROUP);
    if (g >= params.count) {
        return;
    }
    let mean = vec3f(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]);
    var scale = vec3f(log_scales[3u * g], log_scales[3u * g + 1u], log_scales[3u * g + 2u]);
    var finite = all_finite(mean) && is_finite(opacity_logits[g]);
    for (var k = 0u; k < 4u; k++) {
        finite = finite && is_finite(quaternions[4u * g + k]);
    }
    for (var k = 3u * g * params.harmonics; k < 3u * (g + 1u) * params.harmonics; k++) {
        finite = finite && is_finite(sh[k]);
    }
    if (finite && all_finite(scale)) { // (what is not finite goes as a whole)
        var nearest = FAR_PLANE;
        for (var k = 0u; k < params.centres; k++) {
            let away = mean - vec3f(centres[3u * k], centres[3u * k + 1u], centres[3u * k + 2u]);
            nearest = min(nearest, length(away));
        }
        let most = log(max(params.largest * nearest, 1e-30));
        if (max(max(scale.x, scale.y), scale.z) > most) {
            atomicAdd(&found[0], 1u);
            scale = min(scale, vec3f(most));
            for (var k = 0u; k < 3u; k++) {
                log_scales[3u * g + k] = scale[k];
            }
        }
        if (any(abs(scale) >= vec3f(LOG_SCALE_LIMIT))) {
            atomicAdd(&found[1], 1u);
        }
    } else {
        atomicAdd(&found[2], 1u);
    }
}
