// Differences of an image's colours to the right and down; none in the last row and the last column.
// uses: items
struct Params { width: u32, height: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> image: array<f32>;

fn at(i: u32) -> vec3f {
    let plane = params.width * params.height;
    return vec3f(image[i], image[plane + i], image[2u * plane + i]);
}

fn has_differences(x: u32, y: u32) -> bool {
    return x + 1u < params.width && y + 1u < params.height;
}
