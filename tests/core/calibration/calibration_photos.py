"""Synthetic calibration photos: what a camera would file of a point or an edge through a Gaussian medium."""

import math
from pathlib import Path

import numpy as np
import tifffile
from dgs.core.colour import linear_to_srgb
from PIL import Image
from scipy.special import ndtr

FINER = 5


def _pixels(fine: np.ndarray) -> np.ndarray:
    """Mean over the pixel's own area."""
    h, w = fine.shape[0] // FINER, fine.shape[1] // FINER
    return fine.reshape(h, FINER, w, FINER).mean(axis=(1, 3))


def _grid(size: int) -> tuple[np.ndarray, np.ndarray]:
    t = (np.arange(size * FINER) + 0.5) / FINER
    return np.meshgrid(t, t)


def point_light(size, place, sx, sy=None, angle=0.0, amplitude=0.6, background=(0.03, 0.0)):
    """`background`: its level in the middle, and how much it rises from one side to the other."""
    x, y = _grid(size)
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    dx, dy = x - place[0], y - place[1]
    u, v = dx * c + dy * s, -dx * s + dy * c
    shape = np.exp(-0.5 * ((u / sx) ** 2 + (v / (sy or sx)) ** 2))
    return _pixels(background[0] + background[1] * (x / size - 0.5) + amplitude * shape)


def edge_light(size, slant, sigma, offset=0.3, low=0.08, high=0.7):
    x, y = _grid(size)
    n = math.radians(slant)
    d = (x - size / 2 - offset) * math.cos(n) + (y - size / 2) * math.sin(n)
    return _pixels(low + (high - low) * ndtr(d / sigma))


def photo(path: Path, light: np.ndarray, noise=0.002, bits=16, seed=0, encode=True) -> Path:
    """Noise in linear light, then the sRGB curve, then the file's rounding."""
    noisy = light + noise * np.random.default_rng(seed).standard_normal(light.shape)
    values = np.clip(linear_to_srgb(np.clip(noisy, 0, 1)) if encode else noisy, 0, 1)
    if bits == 8:
        Image.fromarray(np.round(values * 255).astype(np.uint8)).save(path)
    else:
        tifffile.imwrite(path, np.round(values * 65535).astype(np.uint16))
    return path
