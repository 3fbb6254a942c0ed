// SSIM's window (`core.training.photometric`): 11 taps along rows or columns; beyond the frame both images are black.
// uses: items
// count: 3 planes; masked: values of the mask, 0 for none
struct Params { width: u32, height: u32, count: u32, masked: u32, error_weight: f32, structure_weight: f32 }
@group(0) @binding(0) var<uniform> params: Params;

fn tap(t: i32) -> f32 {
    var taps = array<f32, WINDOW_REACH + 1>(WINDOW_TAPS);
    return taps[abs(t)];
}
