// The binomial mean of three fields over 3 x 3 px, zeros beyond the frame; it is its own transpose.
// uses: items
struct Params { width: u32, height: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> fields: array<f32>;

fn mean_at(i: u32) -> vec3f {
    let plane = params.width * params.height;
    let middle = vec2i(i32(i % params.width), i32(i / params.width));
    var sum = vec3f(0.0);
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let to = middle + vec2i(x, y);
            if (all(to >= vec2i(0)) && to.x < i32(params.width) && to.y < i32(params.height)) {
                let from_there = u32(to.y) * params.width + u32(to.x);
                let weight = f32((2 - abs(x)) * (2 - abs(y))) / 16.0;
                sum += weight * vec3f(fields[from_there], fields[plane + from_there], fields[2u * plane + from_there]);
            }
        }
    }
    return sum;
}
