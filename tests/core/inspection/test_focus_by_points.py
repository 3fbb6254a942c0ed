"""What points say of the photos' foci: what a disk leaves of a band, mixed sets, and sets of which nothing is said.

Foci, aperture and false alarms on drawn scenes: `tests/core/pipeline/effects/test_blurs_that_vary.py`.
"""

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.inspection import focus_by_points as by_points
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.inspection.spectra import SETTINGS as SPECTRA
from scipy import fft
from scipy.special import j1

PHOTOS, POINTS, STRENGTH = 12, 400, 2.5


@pytest.mark.parametrize("sigma", [0.5, 1.0, 2.0])
def test_what_a_disk_leaves_of_a_band_is_what_is_measured(sigma):
    """A texture with the power that scenes have, before a lens and behind it."""
    random, side = np.random.default_rng(1), 512
    u, v = np.meshgrid(fft.fftfreq(side), fft.fftfreq(side), indexing="ij")
    f = np.maximum(np.hypot(u, v), 1.0 / side)
    texture = fft.ifft2(fft.fft2(random.normal(size=(side, side))) * f ** (-0.5 * SPECTRA.slope)).real
    x = np.maximum(2 * np.pi * f * 2 * sigma, 1e-6)  # Airy's law: the radius is twice the standard deviation
    blurred = fft.ifft2(fft.fft2(texture) * 2 * j1(x) / x).real
    at_all = np.stack(np.meshgrid(np.arange(100, 400, 5), np.arange(100, 400, 5)), axis=-1).reshape(-1, 2) + 0.5
    for first in (0.8, 1.6, 3.2):
        energies = [by_points.band_energy(plane + 100.0, 1e-9, first, at_all).mean() for plane in (texture, blurred)]
        said = np.interp(sigma, by_points._DISKS, by_points._left(first, 0.0))
        assert np.log(energies[1] / energies[0]) == pytest.approx(said, rel=0.15, abs=0.05), first


def drawn(strength=STRENGTH, sharp=(), noise=0.12, photos=PHOTOS):
    """Energies as the law has them, of points between depths of 0.7 and 1.6, and the foci."""
    random = np.random.default_rng(2)
    depth = random.uniform(0.7, 1.6, (photos, POINTS))
    foci = random.uniform(0.7, 1.35, photos)
    widths = (0.8, 1.6, 3.2)
    left = np.stack([by_points._left(width, 0.4) for width in widths])
    band, photo, point = (index.ravel() for index in np.indices((3, photos, POINTS)))
    inverse = np.tile((1 / depth).ravel(), 3)
    open_lens = strength * ~np.isin(photo, sharp)
    log_energy = random.normal(0.0, 1.5, (3, POINTS))[band, point] + random.normal(0.0, 0.2, (3, photos))[band, photo]
    sigma = open_lens * np.abs(inverse - foci[photo])
    for index in range(3):
        log_energy[band == index] += np.interp(sigma[band == index], by_points._DISKS, left[index])
    log_energy += noise * random.standard_t(3, len(log_energy))
    rows = [np.flatnonzero(photo == v) for v in range(photos)]
    names = tuple(f"photo_{v:02d}" for v in range(photos))
    seen = by_points._Seen(
        log_energy.astype(np.float32),
        inverse,
        point + POINTS * band,
        photo + photos * band,
        band,
        rows,
        list(range(photos)),
        np.full(photos, 1.02),
        0.8,
        names,
        photos * POINTS,
        photos,
        600.0,
        2,
        1.0,
        left,
    )
    return seen, foci


def found_in(seen, monkeypatch):
    monkeypatch.setattr(by_points, "_seen", lambda photos: seen)
    return by_points.focus_by_points(None)


def test_foci_and_aperture_are_found_and_a_sharp_photo_is_seen(monkeypatch):
    sharp = (3, 7)
    seen, foci = drawn(sharp=sharp)
    found = found_in(seen, monkeypatch)
    assert found.certain and found.sharp == {seen.names[v] for v in sharp}
    assert found.strength * seen.diagonal == pytest.approx(STRENGTH, rel=0.15)
    assert found.width == pytest.approx(STRENGTH * seen.range / 2 * seen.step, rel=0.15)
    for v in set(range(PHOTOS)) - set(sharp):
        assert found.foci[seen.names[v]] == pytest.approx(foci[v], abs=0.06)
    assert found == found_in(seen, monkeypatch)
    few = found_in(replace(seen, photos=3 * PHOTOS), monkeypatch)  # most photos show no points
    assert few.clear and not few.certain


def test_nothing_is_seen_in_sharp_photos_nor_in_blur_that_is_alike_at_all_depths(monkeypatch):
    seen, _ = drawn(strength=0.0)
    assert not found_in(seen, monkeypatch).clear
    # Each photo is blurred by another width, as a shake does.
    width = np.random.default_rng(3).normal(0.0, 1.0, PHOTOS)
    blurred = seen.log_energy - np.float32(0.4) * width.astype(np.float32)[seen.photo % PHOTOS]
    assert not found_in(replace(seen, log_energy=blurred), monkeypatch).clear


def test_nothing_is_said_of_photos_without_cameras():
    grey = PhotoSet([], None)
    assert by_points.focus_by_points(grey) is None
