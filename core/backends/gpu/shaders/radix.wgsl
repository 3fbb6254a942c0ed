// A stable radix sort. A group takes a chunk of keys; each pass sorts by a digit of them, as counts[chunk][digit] says
// how often every chunk has each digit. The first pass' counts are an order of their own; a pass that moves the keys
// makes those of the next one.
struct Params {
    count: u32,
    chunk: u32,
    chunks: u32,
    shift: u32,
    mask: u32,
    next_shift: u32,
    next_mask: u32,  // none in the last pass
    numbered: u32,  // the values are the keys' places, and are not read
}
const DIGITS = 1u << SORT_BITS;
const_assert DIGITS == SCAN_GROUP;  // a thread takes a digit
