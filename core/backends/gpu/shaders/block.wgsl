// The px that a thread of a block works on: blocks stand in rows as px do, and no thread divides by a frame's width.
fn pixel_of(group: vec3u, thread: u32) -> vec2u {
    return vec2u(group.x * BLOCK_WIDE + thread % BLOCK_WIDE, group.y * BLOCK_HIGH + thread / BLOCK_WIDE);
}
