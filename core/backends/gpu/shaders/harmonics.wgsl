// The 16 real spherical harmonics of unit directions, with the signs and the order of 3DGS files.
fn harmonics(d: vec3f) -> array<f32, 16> {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    return array<f32, 16>(
        SH_C0,
        -SH_C1 * y,
        SH_C1 * z,
        -SH_C1 * x,
        SH_C2_0 * x * y,
        SH_C2_1 * y * z,
        SH_C2_2 * (2.0 * zz - xx - yy),
        SH_C2_3 * x * z,
        SH_C2_4 * (xx - yy),
        SH_C3_0 * y * (3.0 * xx - yy),
        SH_C3_1 * x * y * z,
        SH_C3_2 * y * (4.0 * zz - xx - yy),
        SH_C3_3 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        SH_C3_4 * x * (4.0 * zz - xx - yy),
        SH_C3_5 * z * (xx - yy),
        SH_C3_6 * x * (xx - 3.0 * yy),
    );
}

// Gradient of sum_k w[k] harmonics[k] with respect to the direction.
fn harmonics_gradient(d: vec3f, w: array<f32, 16>) -> vec3f {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    return vec3f(
        -SH_C1 * w[3] + SH_C2_0 * y * w[4] - 2.0 * SH_C2_2 * x * w[6] + SH_C2_3 * z * w[7]
            + 2.0 * SH_C2_4 * x * w[8] + SH_C3_0 * 6.0 * x * y * w[9] + SH_C3_1 * y * z * w[10]
            - SH_C3_2 * 2.0 * x * y * w[11] - SH_C3_3 * 6.0 * x * z * w[12]
            + SH_C3_4 * (4.0 * zz - 3.0 * xx - yy) * w[13] + SH_C3_5 * 2.0 * x * z * w[14]
            + SH_C3_6 * 3.0 * (xx - yy) * w[15],
        -SH_C1 * w[1] + SH_C2_0 * x * w[4] + SH_C2_1 * z * w[5] - 2.0 * SH_C2_2 * y * w[6]
            - 2.0 * SH_C2_4 * y * w[8] + SH_C3_0 * 3.0 * (xx - yy) * w[9] + SH_C3_1 * x * z * w[10]
            + SH_C3_2 * (4.0 * zz - xx - 3.0 * yy) * w[11] - SH_C3_3 * 6.0 * y * z * w[12]
            - SH_C3_4 * 2.0 * x * y * w[13] - SH_C3_5 * 2.0 * y * z * w[14] - SH_C3_6 * 6.0 * x * y * w[15],
        SH_C1 * w[2] + SH_C2_1 * y * w[5] + 4.0 * SH_C2_2 * z * w[6] + SH_C2_3 * x * w[7]
            + SH_C3_1 * x * y * w[10] + SH_C3_2 * 8.0 * y * z * w[11]
            + SH_C3_3 * (6.0 * zz - 3.0 * xx - 3.0 * yy) * w[12] + SH_C3_4 * 8.0 * x * z * w[13]
            + SH_C3_5 * (xx - yy) * w[14],
    );
}
