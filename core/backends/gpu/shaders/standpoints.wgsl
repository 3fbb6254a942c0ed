// Where the camera stands in each frame of its path: `poses` [frames] of whoever uses this (`rasterizer.standpoint`).
// uses: view
struct Standpoint { rotation: array<vec4f, 3>, centre_rest: vec4f }

// The view of one frame; that of the first is the view itself.
fn view_from(frame: u32) -> View {
    var seen = view;
    if (frame > 0u) {
        seen.rotation = poses[frame].rotation;
        seen.centre_rest = poses[frame].centre_rest;
    }
    return seen;
}
