// A chunk of a tile's list: its pairs, its tile, and the number of the checkpoint that it begins at, or FRESH or SATURATED.
struct Chunk { first: u32, end: u32, tile: u32, begins: u32 }

const PIXELS = u32(TILE * TILE);

// Number of the checkpoint at a tile's chunk after its first: no two of them are one, and fewer than pairs / CHUNK are
// there, as each has a whole chunk of its own tile before it.
fn checkpoint_of(first_of_tile: u32, chunk: u32) -> u32 {
    return first_of_tile / CHUNK + chunk - 1u;
}
