"""The five row filters of PNG undone, in place."""

from __future__ import annotations

from ..compiled import kernel


@kernel
def unfilter(rows, step):  # type: ignore[no-untyped-def]
    """rows: [H, 1 + bytes] uint8, first byte of each row its filter; step: bytes per pixel."""
    for y in range(rows.shape[0]):
        kind = rows[y, 0]
        for x in range(1, rows.shape[1]):
            left = int(rows[y, x - step]) if x > step else 0
            up = int(rows[y - 1, x]) if y > 0 else 0
            corner = int(rows[y - 1, x - step]) if y > 0 and x > step else 0
            guess = 0
            if kind == 1:
                guess = left
            elif kind == 2:
                guess = up
            elif kind == 3:
                guess = (left + up) // 2
            elif kind == 4:
                base = left + up - corner
                d_left, d_up, d_corner = abs(base - left), abs(base - up), abs(base - corner)
                if d_left <= d_up and d_left <= d_corner:
                    guess = left
                elif d_up <= d_corner:
                    guess = up
                else:
                    guess = corner
            rows[y, x] = (int(rows[y, x]) + guess) & 255
