// One pass of a stable radix sort. A group takes a block of SORT_GROUP * SORT_RUN keys, a thread a run of them.
// uses: items
struct Params { count: u32, shift: u32, blocks: u32 }
const DIGITS = 1u << SORT_BITS;
const BLOCK = SORT_GROUP * SORT_RUN;

fn digit_of(key: u32, shift: u32) -> u32 {
    return (key >> shift) & (DIGITS - 1u);
}
