"""Blur by runs of equal taps: what every tap by itself gives, whatever is left out."""

import numpy as np
import pytest
import torch
from dgs.core.frames import Frame
from dgs.core.imaging.compiled_blurs import KernelRows, Runs, reads_by_runs
from dgs.core.imaging.evaluations import Fourier, candidates
from dgs.core.imaging.formation.occluding import OccludingBlur, disk
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import point_spread_from_samples
from scipy import ndimage

CPU = torch.device("cpu")


def frame_of(channels: int, height: int, width: int, seed: int = 0) -> torch.Tensor:
    """Random px, most of them zero: blocks of the frame are empty, and so are whole rows and the last columns."""
    random = np.random.default_rng(seed).uniform(-1.0, 1.0, (channels, height, width)).astype(np.float32)
    random[:, : height // 3] = 0
    random[:, :, 70:150] = 0
    random[0, :, -9:] = 0
    return torch.from_numpy(random)


#: Wide and narrow, and one that no mirror maps to itself.
LOPSIDED = np.pad(disk(3.0), ((0, 2), (4, 0)))
KERNELS = {"wide": disk(6.0), "narrow": disk(2.1), "lopsided": LOPSIDED / LOPSIDED.sum()}


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("margin", [0, 3, 30])
@pytest.mark.parametrize("width", [64, 65, 200])
def test_runs_are_the_kernel_and_its_transpose(name, margin, width):
    kernel, frame = KERNELS[name], Frame(50, width, margin)
    fast, exact = Runs(kernel, frame), Fourier(kernel, frame, torch.float64, CPU)
    light = frame_of(3, *frame.rendered)
    assert torch.allclose(fast.apply(light).double(), exact.apply(light.double()), atol=3e-6)
    photo = frame_of(3, 50, width, 1)
    assert torch.allclose(fast.adjoint(photo).double(), exact.adjoint(photo.double()), atol=2e-5)


def test_a_lamp_costs_its_row_no_more_than_rounding():
    """Sums from the left are largest behind a px that outshines all others: as a share of it, nothing is lost."""
    frame = Frame(40, 300, 0)
    fast, exact = Runs(disk(5.0), frame), Fourier(disk(5.0), frame, torch.float64, CPU)
    light = torch.rand(1, 40, 300, generator=torch.Generator().manual_seed(5))
    light[0, 20, 10] = 1e6
    for found, wanted in (
        (fast.apply(light), exact.apply(light.double())),
        (fast.adjoint(light), exact.adjoint(light.double())),
    ):
        assert float((found.double() - wanted).abs().max()) < 1e-7 * 1e6


def test_some_rows_are_those_of_the_whole_to_the_bit():
    fast, light = Runs(disk(4.0), Frame(60, 90, 2)), frame_of(2, 64, 94)
    for rows in (range(60), range(5, 60, 7), range(59, 60)):
        assert torch.equal(fast.apply_rows(light, rows), fast.apply(light)[:, rows.start : rows.stop : rows.step])


@pytest.mark.parametrize("margin", [0, 3, 30])
def test_a_part_of_the_transpose_is_that_of_the_whole_to_the_bit(margin):
    frame = Frame(50, 150, margin)
    fast, photo = Runs(disk(3.0), frame), frame_of(2, 50, 150)
    whole = fast.adjoint(photo)
    for wanted in (torch.zeros(frame.rendered, dtype=torch.bool), torch.rand(frame.rendered) > 0.999):
        wanted[7, :3] = wanted[-1, -1] = True
        some = fast.adjoint_at(photo, wanted)
        assert torch.equal(some[:, wanted], whole[:, wanted])
        assert float((some == 0).float().mean()) > 0.2, "nothing was left out"


def test_reads_of_a_row():
    rows = KernelRows.of(np.array([[0, 1, 2, 2, 2, 2, 3.0], [0, 0, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0, 1]]), 100)
    assert rows.starts.tolist() == [0, 4, 4, 7]
    assert (rows.offsets // 4).tolist() == [106, 102, 1, 6, 0, 1, 6] and rows.reach == 6
    assert rows.weights.tolist() == [2, -2, 1, 3, 1, 1, 1]


def test_only_kernels_with_runs_are_summed_by_runs():
    noise = np.random.default_rng(0).uniform(0.5, 1.0, (15, 15))
    assert reads_by_runs(disk(4.0)) < 0.5
    assert reads_by_runs(noise / noise.sum()) == 1.0 == reads_by_runs(np.ones((1, 1)))
    for kernel, width, dtype, there in (
        (disk(4.0), 64, torch.float32, True),
        (disk(4.0), 63, torch.float32, False),
        (disk(4.0), 64, torch.float64, False),
        (noise, 64, torch.float32, False),
    ):
        found = candidates(point_spread_from_samples(kernel), Frame(40, width, 0), dtype, CPU)
        assert ("runs" in found) == there


def test_runs_are_taken_where_there_are_any():
    psf = point_spread_from_samples(disk(4.0))
    assert BlurOperator(psf, 60, 80).evaluation == "runs"
    assert BlurOperator(psf, 60, 50).evaluation != "runs"
    slow = BlurOperator(psf, 60, 80, evaluation="fourier")
    photo = frame_of(1, 60, 80)
    assert torch.equal(slow.adjoint_at(photo, torch.zeros(60, 80, dtype=torch.bool)), slow.adjoint(photo))


def test_a_lens_blurs_as_in_double_precision():
    """The levels of a real blur by depth, most of them nearly empty."""
    height, width = 90, 140
    light = torch.from_numpy(np.random.default_rng(2).uniform(0.0, 1.0, (3, height, width)))
    widths = ndimage.gaussian_filter(np.random.default_rng(3).normal(size=(height, width)), 12.0)
    widths = torch.from_numpy(widths / abs(widths).max() * 3.0)
    widths[30:60, 40:80] = 2.5  # something nearer, with an edge
    fine, coarse = OccludingBlur(widths, "disk"), OccludingBlur(widths.float(), "disk")
    seen, rough = fine.apply(light), coarse.apply(light.float())
    assert torch.allclose(rough.double(), seen, atol=1e-5)
    rows = range(3, height, 5)
    assert torch.equal(coarse.apply_rows(light.float(), rows), rough[:, 3::5])
    upstream = torch.from_numpy(np.random.default_rng(4).normal(size=(3, height, width)))
    wanted, found = fine.adjoint(upstream, light, seen), coarse.adjoint(upstream.float(), light.float(), rough)
    for exact, single in zip(wanted, found, strict=True):
        assert exact is not None and single is not None
        assert (single.double() - exact).abs().max() < 2e-5 * exact.abs().max()
