"""How work is cut up on the card, shared by shaders and the code that calls them."""

from __future__ import annotations

from ...rasterizer.projection_kernels import BEHIND, DEGENERATE, NON_FINITE, OUTSIDE, SEEN, TRANSPARENT

#: Threads of a group that takes one item each.
GROUP = 64
#: Threads of a group that sorts, and how many keys each of them takes, one after the other.
SORT_GROUP, SORT_RUN = 64, 16
#: Bits of a key that one pass sorts by.
SORT_BITS = 4
#: Threads of the one group that adds up a whole table, and how many values each takes at a time.
SCAN_GROUP, SCAN_RUN = 256, 8
#: Gaussians of a tile that the backward pass takes at once, a thread each.
BUCKET = 32
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
