"""What `--until-quality` takes."""

from __future__ import annotations

import argparse
import math
from typing import Literal


def quality(text: str) -> float | Literal["plateau"]:
    """'plateau', or a PSNR in dB from '28', '28.5dB' or '28.5 dB'."""
    told = text.strip().lower()
    if told == "plateau":
        return "plateau"
    try:
        value = float(told.removesuffix("db"))
    except ValueError:
        value = math.nan
    if not 0.0 < value < 100.0:
        raise argparse.ArgumentTypeError(f"'{text}' is neither plateau nor a PSNR in dB such as 28.5")
    return value
