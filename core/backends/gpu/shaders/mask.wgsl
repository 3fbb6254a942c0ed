// Which values of a photo count, a byte for each, in `mask`; all where `params.masked` is 0.
fn in_mask(at: u32) -> bool {
    return params.masked == 0u || ((mask[at / 4u] >> (8u * (at & 3u))) & 0xffu) != 0u;
}
