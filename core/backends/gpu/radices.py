"""How Fourier transforms of one length are cut into passes, and the text of a shader's passes.

The text is written for each length: a compiler that is given every radix keeps values in registers and leaves nothing
out but what is never used.
"""

from __future__ import annotations

from functools import lru_cache

from .layout import LARGEST_RADIX, LINE_GROUP, LINE_VALUES


@lru_cache(maxsize=4096)
def factors(length: int) -> tuple[int, ...] | None:
    """Factors up to `LARGEST_RADIX`, fours before twos; None where there is a larger prime."""
    found = []
    for factor in (5, 4, 3, 2):
        while length % factor == 0:
            found.append(factor)
            length //= factor
    assert max(found, default=1) <= LARGEST_RADIX
    return (tuple(found) or (1,)) if length == 1 else None


def lines_of_group(length: int) -> int:
    """Lines of this length that one group transforms."""
    return LINE_VALUES // max(2, length)


def passes_text(length: int) -> str:
    """WGSL: all passes over lines of this length; see `transform_lines.wgsl`."""
    radices, done, text = (
        factors(length),
        1,
        [f"const LENGTH = {length}u;", f"const LINES = {lines_of_group(length)}u;"],
    )
    assert radices is not None and length <= LINE_VALUES
    text.append("fn all_passes(first_line: u32, thread: u32) {")
    for place, radix in enumerate(radices):
        apart = length // radix
        rounds = range(-(-lines_of_group(length) * apart // LINE_GROUP))
        text.append(f"let pass_{place} = Pass(first_line, {radix}u, {done}u, {apart}u);")
        text += [f"let x_{place}_{n} = butterfly(pass_{place}, thread + {n}u * LINE_GROUP);" for n in rounds]
        text.append("workgroupBarrier();")
        text += [f"put(pass_{place}, thread + {n}u * LINE_GROUP, x_{place}_{n});" for n in rounds]
        text.append("workgroupBarrier();")
        done *= radix
    return "\n".join([*text, "}"])
