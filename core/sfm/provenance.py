"""How the numbers of the first surface at known cameras came about, for `core.numbers.number`."""

#: What chose them.
FIRST_TRIED = "the first value that was tried (lego, 91 photos)"
#: What they were checked on.
LOOKED_AT = "a room rendered by Cycles, 63 photos: the whole only"
