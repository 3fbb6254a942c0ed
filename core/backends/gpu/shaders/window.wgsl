// SSIM's window (`core.training.photometric`) on a block of one plane and what lies within its reach: 11 taps along
// columns, then along rows, in the group's memory. Beyond the frame both images are black.
// uses: view, mask
struct Params {
    width: u32,
    height: u32,
    count: u32,       // of all planes
    blocks_down: u32, // of one plane; those of all planes stand below each other
    masked: u32,      // 0: there is no mask
    mask_plane: u32,  // values between two planes' masks; 0 where all share one
    error_weight: f32,
    structure_weight: f32,
}
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> photo: array<f32>;
@group(0) @binding(3) var<storage, read> mask: array<u32>; // a byte for each value

const REACHED_WIDE = BLOCK_WIDE + 2u * WINDOW_REACH;
const REACHED = REACHED_WIDE * (BLOCK_HIGH + 2u * WINDOW_REACH); // px of a block and around it
const COLUMNS = REACHED_WIDE * BLOCK_HIGH;                       // px of the rows of a block

struct Block {
    corner: vec2u,
    plane: u32,
}

fn block_of(group: vec3u) -> Block {
    let down = group.y % params.blocks_down;
    return Block(vec2u(group.x * BLOCK_WIDE, down * BLOCK_HIGH), group.y / params.blocks_down);
}

// The px number i of a block and what lies around it, if it is in the frame.
struct Place {
    inside: bool,
    i: u32, // of the image's values
    in_mask: u32,
}

fn place_at(block: Block, column: u32, row: u32) -> Place {
    let x = block.corner.x + column - WINDOW_REACH; // (what lies left of the frame or above it wraps around)
    let y = block.corner.y + row - WINDOW_REACH;
    let in_plane = y * params.width + x;
    let inside = x < params.width && y < params.height;
    let in_mask = block.plane * params.mask_plane + in_plane;
    return Place(inside, block.plane * params.width * params.height + in_plane, in_mask);
}

fn counts(at: Place) -> bool {
    return is_finite(photo[at.i]) && in_mask(at.in_mask);
}

// Render and photo, both grey where the photo does not count.
fn pair_at(at: Place) -> vec2f {
    if (counts(at)) {
        return vec2f(image[at.i], photo[at.i]);
    }
    return vec2f(PHOTO_FILL);
}
