// The item that a thread of a long row of groups works on; groups stand in a rectangle of any width.
fn item(group: vec3u, groups: vec3u, thread: u32, threads: u32) -> u32 {
    return (group.y * groups.x + group.x) * threads + thread;
}
