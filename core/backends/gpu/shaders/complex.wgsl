fn product(x: vec2f, y: vec2f) -> vec2f {
    return vec2f(x.x * y.x - x.y * y.y, x.x * y.y + x.y * y.x);
}
