"""The medium: shared and per-view point spreads, blur in sRGB or in linear light."""

import math

import pytest
import torch
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.errors import PsfError
from dgs.core.forward import FixedMedium
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf_text import parse_psf


def test_per_view_spreads():
    shared, own = parse_psf("gaussian:5"), parse_psf("gaussian:2")
    medium = Medium(shared, per_view={"a.png": own, "b.png": None})
    assert medium.psf_for("a.png") is own and medium.psf_for("b.png") is None and medium.psf_for("c.png") is shared
    assert medium.blurs and not Medium().blurs and Medium(None, per_view={"a": own}).blurs
    coarse = medium.on_grid(2.0).psf_for("a.png")
    assert coarse is not None and coarse.sigma_x == pytest.approx(math.sqrt(4.25) / 2)
    with pytest.raises(PsfError):
        Medium(blur_space="xyz")  # type: ignore[arg-type]


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_two_tone_edge_in_either_space(space):
    psf = parse_psf("gaussian:4")
    frame = torch.full((3, 20, 81), 0.2, dtype=torch.float64)
    frame[:, :, 40:] = 0.9
    out = FixedMedium(BlurOperator(psf, 20, 81, dtype=torch.float64), space).degraded(frame)[0, 10]
    low, high = (frame[0, 0, 0], frame[0, 0, -1])
    for x in range(30, 50):
        share = 0.5 * (1 + math.erf((x - 39.5) / (4 * math.sqrt(2))))
        if space == "linear":
            expected = linear_to_srgb(srgb_to_linear(low) * (1 - share) + srgb_to_linear(high) * share)
        else:
            expected = low * (1 - share) + high * share
        assert float(out[x]) == pytest.approx(float(expected), abs=1e-3)
