"""What the medium and the camera do to a sharp picture, written apart from the engine's operator.

A twin that is scored on data made by its own convolution proves little, so nothing of
`core.imaging` is used here but the reader of kernel files. Needs numpy only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.errors import PsfError
from ...core.imaging.kernel_files import read_kernel
from .contrast import curve_of

_FORMS = "Write none, gaussian:SIGMA, gaussian:SX,SY,ANGLE, disk:RADIUS or file:PATH"


#: px that a blur is wide at most; the samples of a wider one would fill the memory.
WIDEST = 1000.0
#: Half of what a file of 16 bits can tell from none.
_LEAST_ALPHA = 0.5 / 65535.0


@dataclass(frozen=True)
class Sensor:
    """What counts the light and stores it.

    Attributes:
        bits: 8 or 16.
        noise: standard deviation, of encoded values in [0, 1], added before rounding.
        full_well: electrons that white is: light is counted in whole ones, with Poisson's noise; 0 for no counting.
        read_noise: electrons rms that are added to the count.
        contrast: the camera's own curve on sRGB values (`curved`); '' for none.
    """

    bits: int
    noise: float = 0.0
    full_well: float = 0.0
    read_noise: float = 0.0
    contrast: str = ""


def curved(encoded: NDArray[np.float64], contrast: str) -> NDArray[np.float64]:
    """What a camera with a curve of its own stores in the place of sRGB values in [0, 1]; black and white stay.

    Args:
        contrast: 's:POWER' makes an S, x^a / (x^a + (1 - x)^a); 'film:STRENGTH' presses lights together as film does,
            (1 - exp(-k x)) / (1 - exp(-k)). Neither is of the engine's own family.
    """
    kind, value = curve_of(contrast)
    x = np.clip(encoded, 0.0, 1.0)
    if kind == "film":
        return np.asarray(np.expm1(-value * x) / math.expm1(-value))
    return np.asarray(x**value / (x**value + (1 - x) ** value))


def kernel_of(psf: str) -> NDArray[np.float64]:
    """Samples of the point spread function at pixel centres: [K, L] odd sizes, sum 1, float64.

    Args:
        psf: see `SynthesizeSettings.psf`; 'disk:RADIUS' is a defocus, of another family.

    Raises:
        PsfError: the text or the file makes no sense.
    """
    kind, _, rest = psf.partition(":")
    if kind == "none" and not rest:
        return np.ones((1, 1))
    if kind == "file" and rest:
        return _from_file(Path(rest))
    try:
        numbers = [float(value) for value in rest.split(",")]
    except ValueError:
        numbers = []
    if any(not math.isfinite(value) for value in numbers) or any(value < 0 for value in numbers[:2]):
        numbers = []
    if max(numbers[:2], default=0.0) > WIDEST:
        raise PsfError(f"The point spread function '{psf[:60]}' is wider than any photo", f"Give at most {WIDEST:g} px")
    if kind == "gaussian" and len(numbers) in (1, 3):
        return _gaussian(numbers[0], numbers[1] if len(numbers) == 3 else numbers[0], (numbers[2:] or [0.0])[0])
    if kind == "disk" and len(numbers) == 1:
        return _disk(numbers[0])
    raise PsfError(f"The point spread function '{psf}' makes no sense", _FORMS)


def blur(planes: NDArray[np.float64], kernel: NDArray[np.float64], margin: int) -> NDArray[np.float64]:
    """Convolves [H, W, 3] pixels and cuts `margin` pixels from each side.

    Where the kernel reaches beyond the margin, the outermost pixels are repeated.
    """
    rows, columns = kernel.shape[0] // 2, kernel.shape[1] // 2
    if kernel.size > 1:
        padded = np.pad(planes, ((rows, rows), (columns, columns), (0, 0)), mode="edge")
        shape = padded.shape[:2]
        spot = np.zeros(shape)
        spot[: kernel.shape[0], : kernel.shape[1]] = kernel
        spot = np.roll(spot, (-rows, -columns), axis=(0, 1))
        transfer = np.fft.rfft2(spot)[..., None]
        blurred = np.fft.irfft2(np.fft.rfft2(padded, axes=(0, 1)) * transfer, s=shape, axes=(0, 1))
        planes = blurred[rows : shape[0] - rows, columns : shape[1] - columns]
    return planes[margin : planes.shape[0] - margin, margin : planes.shape[1] - margin]


def encode(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear light to sRGB (IEC 61966-2-1), clipped to [0, 1] as a camera clips."""
    light = np.clip(linear, 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def decode(encoded: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse of `encode` in [0, 1]."""
    values = np.clip(encoded, 0.0, 1.0)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def photograph(
    linear: NDArray[np.float32],
    kernel: NDArray[np.float64],
    sensor: Sensor,
    *,
    blur_space: str,
    margin: int,
    seed: tuple[int, int],
    gain: float = 1.0,
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The photo through the medium: [H, W, 3] sRGB-encoded; [H, W, 4] with alpha, colours not multiplied by it.

    A photo with alpha put over a colour is the photo of the object before that colour: in the values that are blurred.

    Args:
        linear: [H + 2 margin, W + 2 margin, 3] linear light, not clipped; [..., 4] with alpha, multiplied by it.
        kernel: point spread function, [K, L].
        sensor: what counts the light and stores it.
        blur_space: 'linear' blurs light before the sensor clips it; 'srgb' blurs what a sharp
            photo would have stored.
        margin: overscan in px.
        seed: of the noise: the data set's and the view's number.
        gain: exposure of this photo, a factor on light.
    """
    light = linear[..., :3].astype(np.float64) * gain
    alpha = linear[..., 3:].astype(np.float64)
    through = _straight(light, alpha, kernel, blur_space, margin) if alpha.size else None
    if through is not None:
        encoded, alpha = through
    elif blur_space == "linear":
        encoded = encode(blur(light, kernel, margin))
    else:
        encoded = blur(encode(light), kernel, margin)
    if sensor.full_well > 0:
        generator = np.random.default_rng((*seed, 23))
        electrons = generator.poisson(np.clip(decode(encoded), 0.0, 1.0) * sensor.full_well)
        encoded = encode((electrons + generator.normal(0.0, sensor.read_noise, electrons.shape)) / sensor.full_well)
    if sensor.contrast:
        encoded = curved(encoded, sensor.contrast)
    if sensor.noise > 0:
        encoded = encoded + np.random.default_rng(seed).normal(0.0, sensor.noise, encoded.shape)
    return quantise(encoded if through is None else np.concatenate([encoded, alpha], axis=-1), sensor.bits)


def over_white(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """[H, W, 3] the object before a white wall, in linear light. linear: [H, W, 4], multiplied by alpha."""
    return linear[..., :3] + (1 - linear[..., 3:])


def _straight(
    light: NDArray[np.float64], alpha: NDArray[np.float64], kernel: NDArray[np.float64], blur_space: str, margin: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Blurred colours (encoded, not multiplied by alpha), and their alpha."""
    inside = np.clip(alpha, 0.0, 1.0)
    if blur_space != "linear":
        light = encode(light / np.maximum(inside, _LEAST_ALPHA)) * inside
    blurred = np.clip(blur(np.concatenate([light, inside], axis=-1), kernel, margin), 0.0, None)
    around = np.clip(blurred[..., 3:], 0.0, 1.0)
    straight = blurred[..., :3] / np.maximum(around, _LEAST_ALPHA)
    return encode(straight) if blur_space == "linear" else straight, around


def exposures(views: int, stops: float, seed: int) -> NDArray[np.float64]:
    """[views] gains of photos whose exposure drifts: a smooth curve that reaches `stops` at most, up or down."""
    if stops == 0 or views == 1:
        return np.ones(views)
    generator = np.random.default_rng((seed, 11))
    at = np.arange(views) / views
    waves = [generator.normal() / k * np.sin(2 * np.pi * (k * at + generator.random())) for k in (1, 2, 3)]
    curve = np.sum(waves, axis=0)
    return np.asarray(2.0 ** (stops * curve / np.abs(curve).max()))


def quantise(encoded: NDArray[np.float64], bits: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Rounds [0, 1] to integers of 8 or 16 bits."""
    full = 2**bits - 1
    whole = np.rint(np.clip(encoded, 0.0, 1.0) * full)
    return whole.astype(np.uint8) if bits == 8 else whole.astype(np.uint16)


def _gaussian(sigma_x: float, sigma_y: float, angle: float) -> NDArray[np.float64]:
    if sigma_x == 0 and sigma_y == 0:
        return np.ones((1, 1))
    if min(sigma_x, sigma_y) < 0.3:
        raise PsfError(
            f"A Gaussian of {min(sigma_x, sigma_y):g} px cannot be sampled on whole pixels", "Give at least 0.3 px"
        )
    reach = math.ceil(6 * max(sigma_x, sigma_y))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float64)
    cosine, sine = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    along, across = (cosine * x + sine * y) / sigma_x, (cosine * y - sine * x) / sigma_y
    kernel = np.exp(-(along**2 + across**2) / 2)
    return kernel / kernel.sum()


def _disk(radius: float) -> NDArray[np.float64]:
    fine, reach = 16, math.ceil(radius)
    side = (2 * reach + 1) * fine
    place = (np.arange(side) + 0.5) / fine - reach - 0.5
    covered = (place[:, None] ** 2 + place**2 <= radius**2).astype(np.float64)
    kernel = covered.reshape(2 * reach + 1, fine, 2 * reach + 1, fine).mean(axis=(1, 3))
    return kernel / kernel.sum() if radius > 0.1 else np.ones((1, 1))


def _from_file(path: Path) -> NDArray[np.float64]:
    kernel = np.asarray(read_kernel(path), dtype=np.float64)
    if kernel.ndim != 2 or not np.all(np.isfinite(kernel)) or kernel.min() < 0 or kernel.sum() <= 0:
        raise PsfError(f"'{path}' holds no point spread function", "Give non-negative, finite values")
    kernel = np.pad(kernel, [(0, 1 - side % 2) for side in kernel.shape])
    return kernel / kernel.sum()
