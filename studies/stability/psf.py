"""The point spread as a linear operator: no width, too much width, sums, centres, borders, adjoints."""

from __future__ import annotations

import math

import numpy as np
import torch

from ...core.colour import linear_to_srgb, srgb_to_linear
from ...core.errors import PsfError
from ...core.forward import FixedMedium
from ...core.imaging.evaluations import REDUCED
from ...core.imaging.fourier import FourierFilter
from ...core.imaging.kernel_samples import disc
from ...core.imaging.operator import BlurOperator
from ...core.imaging.psf import PointSpread, gaussian_taps, point_spread_from_samples
from ...core.imaging.psf_text import parse_psf
from .case import Site, Unexplained, case, explained, worst

#: (text or None for a lopsided file, margin in px)
SPREADS = (
    ("gaussian:5", 20),
    ("gaussian:5", 7),
    ("gaussian:5", 0),
    ("gaussian:2,4,0", 30),
    ("gaussian:3,1.5,25", 5),
    ("gaussian:0.2", 2),
    (None, 1),
)
EVALUATIONS = ("direct", "separable", "fourier", "reduced")


def _spread(text: str | None) -> PointSpread:
    if text is None:
        return point_spread_from_samples(
            np.array([[0, 0, 1, 0, 0], [0, 2, 5, 1, 0], [0, 6, 9, 3, 2], [0, 1, 5, 2, 0], [0, 0, 1, 0, 0.0]])
        )
    psf = parse_psf(text)
    assert psf is not None
    return psf


def _operators(
    psf: PointSpread, height: int, width: int, margin: int, dtype: torch.dtype = torch.float32
) -> list[BlurOperator]:
    """Every evaluation that fits."""
    found = []
    for name in EVALUATIONS:
        try:
            found.append(BlurOperator(psf, height, width, margin, dtype=dtype, evaluation=name))
        except PsfError:  # this evaluation does not fit this spread
            continue
    if not found:
        raise Unexplained(f"no evaluation fits {psf.source}")
    return found


def _noise(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


@case("psf", "no PSF, sigma 0", "the photo's very bits", 0.0, "a count of values that differ")
def no_width(site: Site) -> float:
    """A standard deviation of 0 is a division by zero."""
    frame, differing = _noise(3, 20, 30), 0
    for psf in (None, PointSpread(), _spread("gaussian:0,0,30"), _spread("gaussian:1e-320")):
        operator = BlurOperator(psf, 20, 30)
        for out in (operator.apply(frame), operator.adjoint(frame)):
            differing += int((out != frame).sum())
    return float(differing)


@case(
    "psf",
    "sigma to 0",
    "kernel's slope by sigma stays bounded",
    3.0,
    "sum of |d taps / d sigma| per px; its true maximum is 2.74, near half a px",
)
def sigma_to_zero(site: Site) -> float:
    """Between no blur and a narrow one there is no jump and no pole."""
    worst_slope, step = 0.0, 1e-6
    for sigma in np.concatenate([np.geomspace(1e-12, 0.1, 40), np.linspace(0.1, 2.0, 60)]):
        one, two = gaussian_taps(float(sigma)), gaussian_taps(float(sigma) + step)
        size = max(one.size, two.size)
        one, two = (np.pad(t, (size - t.size) // 2) for t in (one, two))
        if not (np.isfinite(one).all() and np.isfinite(two).all()):
            return math.inf
        if gaussian_taps(float(sigma)).size == gaussian_taps(float(sigma) + step).size:
            worst_slope = max(worst_slope, float(np.abs(one - two).sum()) / step)
    return worst_slope


@case("psf", "constant image", "stays as it is", 2e-6, "float32's rounding over a kernel's sum")
def constant_image(site: Site) -> float:
    """A point spread that does not sum to 1 makes the scene drift in brightness."""
    errors = []
    for text, margin in SPREADS:
        for operator in _operators(_spread(text), 40, 47, margin):
            frame = torch.full((3, 40 + 2 * margin, 47 + 2 * margin), 0.7)
            errors.append(worst(operator.apply(frame), torch.full((3, 40, 47), 0.7)))
    return max(errors)


@case("psf", "kernels are normalised", "sum is 1, also where they are cut off", 1e-12, "float64's rounding")
def normalised(site: Site) -> float:
    """A cut at 3 sigma loses 0.54 % of the light unless the rest is renormalised; a kernel from a file may have
    any sum, which is reported."""
    errors = [abs(float(_spread(text).kernel().sum()) - 1.0) for text, _ in SPREADS]
    errors += [abs(float(gaussian_taps(5.0, cut).sum()) - 1.0) for cut in (1.0, 3.0, 4.0)]
    x = np.arange(-15, 16)
    line = np.exp(-0.5 * (x / 5.0) ** 2) / (5.0 * math.sqrt(2 * math.pi))
    kept = point_spread_from_samples(np.outer(line, line))
    errors.append(abs(float(kept.kernel().sum()) - 1.0))
    lost = 1.0 - float(np.outer(line, line).sum())
    if not (any("sum" in note for note in kept.notes) and 3e-3 < lost < 6e-3):
        raise Unexplained(f"a kernel that lost {lost:.2%} of its light was read without a word")
    return max(errors)


@case(
    "psf",
    "even or off-centre kernels",
    "centroid of the blurred point is 0 px off",
    1e-4,
    "cubic interpolation, cut at 0",
)
def centred(site: Site) -> float:
    """Half a pixel of shift would be taken up by the poses."""
    random, errors = np.random.default_rng(0), []
    blob = np.exp(-0.5 * ((np.arange(12) - 5.2) / 1.7) ** 2)
    kernels = [np.outer(blob, blob), np.pad(np.outer(blob, blob[:9]), ((0, 1), (0, 0))), random.random((4, 4)) + 1]
    spreads = [point_spread_from_samples(k) for k in kernels] + [_spread(text) for text, _ in SPREADS]
    for psf in spreads:
        for operator in _operators(psf, 61, 61, 0, torch.float64):
            frame = torch.zeros(1, 61, 61, dtype=torch.float64)
            frame[0, 30, 30] = 1.0
            out, offset = operator.apply(frame)[0], torch.arange(61) - 30.0
            errors += [abs(float((out.sum(dim=axis) * offset).sum())) for axis in (0, 1)]
    return max(errors)


@case("psf", "PSF wider than the photo", "refused with a way out; just narrower: constant stays", 2e-6, "rounding")
def too_wide(site: Site) -> float:
    """Elsewhere a dark frame, or light that wraps around."""
    with explained(PsfError):
        BlurOperator(_spread("gaussian:16"), 30, 40)
    errors = []
    for operator in _operators(_spread("gaussian:14.5"), 30, 40, 44):
        errors.append(worst(operator.apply(torch.full((1, 118, 128), 0.4)), torch.full((1, 30, 40), 0.4)))
    return max(errors)


@case("psf", "light in a corner", "does not come back at the other side", 1e-6, "rounding of the transform")
def no_wrap(site: Site) -> float:
    """Transforms are periodic; scenes are not."""
    errors = []
    for operator in _operators(_spread("gaussian:4"), 50, 60, 3):
        frame = torch.zeros(1, 56, 66)
        frame[0, 0, 0] = 1.0
        out = operator.apply(frame)[0]
        errors.append(max(float(out[-20:].abs().max()), float(out[:, -20:].abs().max())))
    return max(errors)


@case("psf", "FFT, separable, direct", "agree with the direct sum in float64", 1e-5, "the target; values in [0, 1]")
def evaluations_agree(site: Site) -> float:
    """One operator, three ways to compute it."""
    errors = []
    for text, margin in SPREADS:
        frame = _noise(3, 53 + 2 * margin, 71 + 2 * margin, seed=1)
        psf = _spread(text)
        exact = BlurOperator(psf, 53, 71, margin, dtype=torch.float64, evaluation="fourier").apply(frame.double())
        operators = [o for o in _operators(psf, 53, 71, margin) if o.evaluation != "reduced"]
        if psf.kernel().size <= 31 * 31:
            exact = BlurOperator(psf, 53, 71, margin, dtype=torch.float64, evaluation="direct").apply(frame.double())
        errors += [worst(operator.apply(frame), exact) for operator in operators]
    return max(errors)


@case(
    "psf",
    "reduced resolution",
    "differs from the exact blur by less than it promises",
    REDUCED.tolerance,
    "its own bound",
)
def reduced(site: Site) -> float:
    """Wide blurs are computed on a coarse grid."""
    psf, frame = _spread("gaussian:9"), _noise(3, 80, 90, seed=2)
    exact = BlurOperator(psf, 60, 70, 10, dtype=torch.float64, evaluation="fourier").apply(frame.double())
    return worst(BlurOperator(psf, 60, 70, 10, evaluation="reduced").apply(frame), exact)


def _adjoint_error(dtype: torch.dtype) -> float:
    errors = []
    for text, margin in SPREADS:
        random = torch.Generator().manual_seed(2)
        x = torch.randn(3, 41 + 2 * margin, 60 + 2 * margin, generator=random, dtype=dtype)
        y = torch.randn(3, 41, 60, generator=random, dtype=dtype)
        for operator in _operators(_spread(text), 41, 60, margin, dtype):
            forward = (operator.apply(x).double() * y.double()).sum()
            back = (x.double() * operator.adjoint(y).double()).sum()
            errors.append(float(abs(forward - back) / (x.double().norm() * y.double().norm())))
    return max(errors)


@case("psf", "adjoint, float32", "<Hx, y> = <x, H'y>", 1e-6, "the target; relative to |x| |y|")
def adjoint_float32(site: Site) -> float:
    """A gradient that goes back by anything but the transpose follows no loss."""
    return _adjoint_error(torch.float32)


@case("psf", "adjoint, float64", "<Hx, y> = <x, H'y>", 1e-12, "the target")
def adjoint_float64(site: Site) -> float:
    """The same without the excuse of rounding."""
    return _adjoint_error(torch.float64)


@case(
    "psf",
    "sRGB against linear light",
    "a two-tone edge is the error function, in either space",
    1e-3,
    "a sum of samples is off the integral by slope / 24; the curve is steeper in the dark",
)
def two_tone_edge(site: Site) -> float:
    """A medium blurs light, a virtual blur most likely sRGB values: the edge moves."""
    width, sigma, errors = 81, 4.0, []
    frame = torch.full((3, 30, width), 0.2)
    frame[:, :, 40:] = 0.9
    x = np.arange(25, 56)
    share = torch.tensor([0.5 * (1 + math.erf((p - 39.5) / (sigma * math.sqrt(2)))) for p in x])
    blur = BlurOperator(_spread(f"gaussian:{sigma}"), 30, width)
    low, high = srgb_to_linear(torch.tensor([0.2, 0.9])).tolist()
    for space, expected in (("srgb", 0.2 + 0.7 * share), ("linear", linear_to_srgb(low + (high - low) * share))):
        out = FixedMedium(blur, space).degraded(frame)  # type: ignore[arg-type]
        errors.append(worst(out[1, 15, 25:56], expected))
    return max(errors)


@case(
    "psf",
    "colour curve at 0, at 1 and beyond",
    "finite slopes, inverse of each other",
    2e-6,
    "float32's rounding, relative",
)
def colour_curve(site: Site) -> float:
    """The power's slope at 0 is infinite; renders overshoot below 0 and above 1."""
    values = torch.tensor([-1e4, -1.0, -1e-7, 0.0, 1e-12, 0.0031308, 0.04045, 0.5, 1.0, 2.0, 1e4], requires_grad=True)
    errors = []
    for forth, back in ((srgb_to_linear, linear_to_srgb), (linear_to_srgb, srgb_to_linear)):
        (slope,) = torch.autograd.grad(forth(values).sum(), values)
        again = back(forth(values)).detach()
        finite = bool(slope.isfinite().all() and (slope > 0).all())
        errors.append(
            float(((again - values.detach()).abs() / (values.detach().abs() + 1)).max()) if finite else math.inf
        )
    return max(errors)


@case("psf", "inverse where nothing passes", "finite, and its adjoint exact", 1e-6, "relative to |x| |y|")
def inverse_at_nulls(site: Site) -> float:
    """A box and a disc have zeros in their transfer; Wiener's inverse divides by it."""
    errors = []
    for kernel in (np.ones((9, 9)), disc(5.0), np.eye(11)):
        psf = point_spread_from_samples(kernel)
        for noise in (1e-9, 1e-5, 1e3):
            for kind in ("newton", "wiener"):
                inverse = FourierFilter(psf, (40, 50), noise, kind)  # type: ignore[arg-type]
                x, y = _noise(3, 40, 50, seed=3) - 0.5, _noise(3, 40, 50, seed=4) - 0.5
                there, back = inverse.apply(x), inverse.adjoint(y)
                if not bool(there.isfinite().all() and back.isfinite().all()):
                    return math.inf
                size = float(x.norm() * y.norm()) * float(inverse.transfer.abs().max())
                errors.append(abs(float((there.double() * y).sum() - (x * back.double()).sum())) / size)
    return max(errors)


@case(
    "psf",
    "coarser grids",
    "variance is (sigma^2 + (s^2 - 1) / 12) / s^2, sum 1, centred",
    1e-3,
    "px^2, of cubic resampling",
)
def coarser_grids(site: Site) -> float:
    """Training works on a grid of its own: the point spread must follow exactly."""
    errors = []
    for psf in (_spread("gaussian:5"), _spread("gaussian:2,4,30"), point_spread_from_samples(disc(6.0))):
        for s in (2.0, 3.0, 2.5):
            coarse = psf.on_grid(s)
            wanted = (psf.covariance + np.eye(2) * (s * s - 1) / 12) / s**2
            errors.append(float(np.abs(coarse.covariance - wanted).max()))
            errors.append(abs(float(coarse.kernel().sum()) - 1.0))
    return max(errors)


@case("psf", "kernels that make no sense", "refused with a way out", 0.0, "a count of violations")
def senseless(site: Site) -> float:
    """Negative, NaN, infinite, dark, of one row, far off its middle, larger than a photo; texts with nan and inf."""
    ring = np.zeros((21, 21))
    ring[0, 0] = 1.0
    bad = [
        np.full((5, 5), np.nan),
        np.full((5, 5), np.inf),
        -np.ones((5, 5)),
        np.zeros((5, 5)),
        ring,
        np.ones((2, 1200)),
    ]
    for kernel in bad:
        with explained(PsfError):
            point_spread_from_samples(kernel)
    for text in ("gaussian:nan", "gaussian:inf", "gaussian:-1", "gaussian:", "file:", "gaussian:1,2,3,4", "motion:5"):
        with explained(PsfError):
            parse_psf(text)
    return 0.0
