"""How work is cut up on the card, shared by shaders and the code that calls them."""

from __future__ import annotations

from ...rasterizer.projection_kernels import BEHIND, DEGENERATE, NON_FINITE, OUTSIDE, SEEN, TRANSPARENT

#: Threads of a group that takes one item each.
GROUP = 64
#: Numbers of a projection: Gaussians of each status, and behind them the pairs of a splat and a tile.
REASONS = 8
#: Threads of a group that adds up or sorts: as many as WebGPU promises. Values that each takes at a time in prefix
#: sums: neighbours, 32 bytes, which cards fetch at once.
SCAN_GROUP, SCAN_RUN = 256, 8
#: Chunks, a group each, that a table is cut into for prefix sums at most: enough for every core of the largest cards,
#: few enough that each group can add up what those before it came to (4 numbers a thread).
SCAN_CHUNKS = 1024
#: Keys that a thread of a group takes at a time when it sorts: as their group's counts take no more memory then.
SORT_RUN = 8
#: Bits of a key that one pass sorts by, at most: a thread of the group for each digit.
SORT_BITS = 8
#: Bits that a group sorts a tile of keys by at once: counts of 16 digits of each thread, in half words, take 8 kB, and
#: WebGPU promises 16.
SORT_STEP = 4
#: Chunks, a group each, that keys are cut into at most: each group reads every chunk's counts, one thread a digit, so
#: that their number squared counts; two groups for each of the 132 cores of a large card.
SORT_CHUNKS = 256
#: Banks that a group's memory has on most cards: threads that read from one bank wait for each other.
SORT_BANKS = 32
#: Splats of a tile's list that a group of the backward pass takes, all chunks side by side; the forward pass leaves
#: a checkpoint between two. A checkpoint takes 5 KB, so that of 128 splats as much as their gradient slots (40 bytes
#: each); shorter ones would take more memory than all else, longer ones leave a card idle where lists are short.
CHUNK = 128
#: Values of a pixel in a checkpoint: transmittance, colour so far, depth so far.
CHECKPOINT = 5
#: Threads of the backward pass's group: one warp, as it waits for its slowest thread after every pixel. Each takes up
#: to CHUNK / BUCKET splats, written out one by one in `blend_backward.wgsl`.
BUCKET = 32
#: Pairs of a splat and a tile from which on a card begins to blend before its next orders are written: with fewer it is
#: done before they are, and to start it takes the computer a third of a millisecond (in software; not yet chosen
#: by times on a card).
LONG_LISTS = 1 << 20
#: Where a chunk begins, other than at a checkpoint: at the tile's first splat; behind what every pixel sees.
FRESH, SATURATED = 0xFFFFFFFF, 0xFFFFFFFE
#: Values of a gradient slot: sums of s dx, s t, s dx^2, s dx t, s t^2 and s, where s = alpha dL/dalpha, (dx, dy)
#: reaches from the Gaussian's centre to the pixel, and t = dy - shear dx (`splat.wgsl`); dL/dcolour; dL/ddepth.
SLOT_WIDTH = 10
#: Sums for the pose: rotation, translation, the camera's centre.
POSE_SUMS = 15
#: Gaussians at exactly one depth are put in an order of their own up to so many: comparing them all with each other
#: takes the square of their number.
TIE_LIMIT = 4096
#: Key of the depth of what is not seen: behind everything.
UNSEEN = 0xFFFFFFFF
#: Groups that may stand beside each other in one dimension (WebGPU's least limit).
GROUPS_ACROSS = 65535

#: What is done with every value: a itself, a + p b, a b, a / b, max, min, a within [p, q], a^p, sqrt, |a|, sign, exp,
#: 1 / (1 + exp(-a)), a where a condition holds and else b.
(COPY, SUM, PRODUCT, QUOTIENT, LARGER, SMALLER, LIMITED, POWER, ROOT, SIZE, SIGN, EXPONENTIAL, LOGISTIC, WHERE) = range(
    14
)
#: What makes a truth value of every two.
(GREATER, LESS, GREATER_EQUAL, LESS_EQUAL, EQUAL, UNEQUAL, BOTH, EITHER, NEITHER, IS_NUMBER, NOT_INFINITE) = range(11)
#: What an order's operands are, added up: a number, truth values in bytes; the result is the first one; a conjugate.
A_NUMBER, A_BYTES, B_NUMBER, B_BYTES, IN_PLACE, CONJUGATED = (1 << bit for bit in range(6))
#: Axes of tensors that shaders go along.
AXES = 4
#: Lengths of Fourier transforms are products of numbers up to this one, as `scipy.fft.next_fast_len` makes them.
LARGEST_RADIX = 5
#: What a pass of a transform reads and writes: complex numbers, real ones, the first half of a spectrum whose rest are
#: conjugates.
WHOLE, REAL, HALF = range(3)
#: What becomes of a Gaussian, as the compiled kernels count it.
STATUSES = {
    "SEEN": SEEN,
    "NON_FINITE": NON_FINITE,
    "BEHIND": BEHIND,
    "TRANSPARENT": TRANSPARENT,
    "OUTSIDE": OUTSIDE,
    "DEGENERATE": DEGENERATE,
}
#: Px of a block whose windows one group sums up in its own memory, a thread each: wide, since values that lie side by
#: side are read at once, and as many as fit into 16 KB with what the windows reach around them.
BLOCK_WIDE, BLOCK_HIGH = 32, 8
BLOCK_GROUP = BLOCK_WIDE * BLOCK_HIGH
#: Complex numbers of the lines that one group transforms in its own memory (16 KB), and its threads.
LINE_VALUES, LINE_GROUP = 2048, 256
#: Everything that shaders take from here, by name.
LAYOUT = {name: value for name, value in globals().items() if name.isupper() and isinstance(value, int)}
