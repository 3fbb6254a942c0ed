// One pass: moves keys and values to where their digits begin, counts the next digit in the chunks that they come to,
// and empties the counts of the pass after that. A group takes its chunk tile by tile, and sorts each tile in its own
// memory, so that threads beside each other write beside each other.
// uses: radix, group_sums
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<u32>;
@group(0) @binding(3) var<storage, read> counts: array<u32>;
// (integers: their sum is the same whoever adds first)
@group(0) @binding(4) var<storage, read_write> next_counts: array<atomic<u32>>;
@group(0) @binding(5) var<storage, read_write> later_counts: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> sorted_values: array<u32>;

const TILE_KEYS = SCAN_GROUP * SORT_RUN;
// Every thread's counts of the digits of SORT_STEP bits, two in a word.
const COUNT_WORDS = 1u << (SORT_STEP - 1u);
const CELLS = SCAN_GROUP * max(SORT_RUN, COUNT_WORDS);
// Half a word, in bits: a key of a tile is its digit above and its place in the tile below.
const HALF_WORD = 16u;
const LOW = (1u << HALF_WORD) - 1u;
const_assert TILE_KEYS <= LOW;

// The threads' counts, and then the tile's digits and places: both are never needed at once.
var<workgroup> cells: array<u32, CELLS + CELLS / SORT_BANKS>;
// Where the next key of each digit goes.
var<workgroup> ends: array<u32, DIGITS>;

// A free cell after every SORT_BANKS: threads that go through neighbouring rows then meet different banks of memory.
fn cell(i: u32) -> u32 {
    return i + i / SORT_BANKS;
}

// Sorts a tile, stably, by SORT_STEP bits from `shift` on. Each thread's SORT_RUN keys stand in `own`, before and after;
// after, they stand in `cells` too.
fn sort_tile(thread: u32, shift: u32, own: ptr<function, array<u32, SORT_RUN>>) {
    for (var word = 0u; word < COUNT_WORDS; word++) {
        cells[cell(word * SCAN_GROUP + thread)] = 0u;
    }
    var at: array<u32, SORT_RUN>;
    for (var k = 0u; k < SORT_RUN; k++) {
        let digit = ((*own)[k] >> shift) & (2u * COUNT_WORDS - 1u);
        let count = cell((digit % COUNT_WORDS) * SCAN_GROUP + thread);
        let half = digit / COUNT_WORDS * HALF_WORD;
        at[k] = (cells[count] >> half) & LOW;
        cells[count] += 1u << half;
    }
    workgroupBarrier();
    var sum = 0u;
    for (var word = 0u; word < COUNT_WORDS; word++) {
        sum += cells[cell(thread * COUNT_WORDS + word)];
    }
    let sums = sums_before(thread, sum);
    // (the digits in the upper halves come after all those in the lower ones)
    var running = sums.x + (sums.y << HALF_WORD);
    for (var word = 0u; word < COUNT_WORDS; word++) {
        let place = cell(thread * COUNT_WORDS + word);
        let count = cells[place];
        cells[place] = running;
        running += count;
    }
    workgroupBarrier();
    for (var k = 0u; k < SORT_RUN; k++) {
        let digit = ((*own)[k] >> shift) & (2u * COUNT_WORDS - 1u);
        let count = cells[cell((digit % COUNT_WORDS) * SCAN_GROUP + thread)];
        at[k] += (count >> (digit / COUNT_WORDS * HALF_WORD)) & LOW;
    }
    workgroupBarrier();
    for (var k = 0u; k < SORT_RUN; k++) {
        cells[cell(at[k])] = (*own)[k];
    }
    workgroupBarrier();
    for (var k = 0u; k < SORT_RUN; k++) {
        (*own)[k] = cells[cell(thread * SORT_RUN + k)];
    }
    workgroupBarrier();
}

// The digits and places of the tile that begins at `first`, sorted, into `cells`: a mask has one bit at least.
fn take_tile(thread: u32, first: u32) {
    var own: array<u32, SORT_RUN>;
    for (var k = 0u; k < SORT_RUN; k++) {
        let place = thread * SORT_RUN + k;
        var digit = params.mask;  // (behind the last key: comes last)
        if (first + place < params.count) {
            digit = (keys[first + place] >> params.shift) & params.mask;
        }
        own[k] = (digit << HALF_WORD) | place;
    }
    for (var step = 0u; (params.mask >> step) != 0u; step += SORT_STEP) {
        sort_tile(thread, HALF_WORD + step, &own);
    }
}

@compute @workgroup_size(SCAN_GROUP)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    var before = 0u;
    var all = 0u;
    for (var chunk = 0u; chunk < params.chunks; chunk++) {
        let count = counts[chunk * DIGITS + thread];
        all += count;
        before += select(0u, count, chunk < group.x);
    }
    ends[thread] = sums_before(thread, all).x + before;
    later_counts[group.x * DIGITS + thread] = 0u;

    let end = min((group.x + 1u) * params.chunk, params.count);
    for (var first = group.x * params.chunk; first < end; first += TILE_KEYS) {
        take_tile(thread, first);
        let size = min(TILE_KEYS, end - first);
        // for the moment less the place where the tile's keys of this digit begin
        for (var j = thread; j < size; j += SCAN_GROUP) {
            let digit = cells[cell(j)] >> HALF_WORD;
            if (j == 0u || cells[cell(j - 1u)] >> HALF_WORD != digit) {
                ends[digit] -= j;
            }
        }
        workgroupBarrier();
        for (var j = thread; j < size; j += SCAN_GROUP) {
            let found = cells[cell(j)];
            let from_place = first + (found & LOW);
            let to = ends[found >> HALF_WORD] + j;
            let key = keys[from_place];
            sorted_keys[to] = key;
            if (params.numbered != 0u) {
                sorted_values[to] = from_place;
            } else {
                sorted_values[to] = values[from_place];
            }
            if (params.next_mask != 0u) {
                let digit = (key >> params.next_shift) & params.next_mask;
                atomicAdd(&next_counts[to / params.chunk * DIGITS + digit], 1u);
            }
        }
        workgroupBarrier();
        for (var j = thread; j < size; j += SCAN_GROUP) {
            let digit = cells[cell(j)] >> HALF_WORD;
            if (j + 1u == size || cells[cell(j + 1u)] >> HALF_WORD != digit) {
                ends[digit] += j + 1u;
            }
        }
        workgroupBarrier();
    }
}
