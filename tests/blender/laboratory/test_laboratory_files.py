"""Files of the laboratory as other programs read them."""

import numpy as np
import pycolmap
import pytest
from dgs.core.views import SparsePoints
from dgs.dgs_addon.laboratory import files, rail
from PIL import Image
from skimage import io


@pytest.mark.parametrize("bits", [8, 16])
def test_png_is_read_back_exactly(tmp_path, bits):
    dtype = np.uint8 if bits == 8 else np.uint16
    pixels = np.random.default_rng(bits).integers(0, 2**bits, (13, 17, 3)).astype(dtype)
    files.write_png(tmp_path / "a.png", pixels)
    if bits == 8:
        np.testing.assert_array_equal(io.imread(tmp_path / "a.png"), pixels)
    else:
        # Pillow keeps the high bytes only; the low ones are proved by our own reader's twin in core.
        from dgs.core.photos.png16 import read_png16

        np.testing.assert_array_equal(read_png16(tmp_path / "a.png"), pixels)
    high = (pixels >> (bits - 8)).astype(np.uint8)
    np.testing.assert_array_equal(files.read_png(tmp_path / "a.png"), high)


def test_grey_png(tmp_path):
    mask = np.eye(6, 9, dtype=np.uint8) * 255
    files.write_png(tmp_path / "m.png", mask)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "m.png")), mask)


def test_colmap_reads_the_cameras(tmp_path):
    cameras = rail.cameras("dome", 5, 320, 214)
    points = SparsePoints(np.array([[0.1, -0.2, 0.3]]), np.array([[1, 2, 3]], dtype=np.uint8))
    files.write_colmap_text(tmp_path, cameras, points)
    model = pycolmap.Reconstruction(str(tmp_path))
    images = {image.name: image for image in model.images.values()}
    assert set(images) == {camera.name for camera in cameras}
    place = np.array([0.02, -0.05, 0.03])
    for camera in cameras:
        x, y, z = camera.rotation @ place + camera.translation
        ours = [camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy]
        np.testing.assert_allclose(images[camera.name].project_point(place), ours, atol=1e-6)
    (point,) = model.points3D.values()
    np.testing.assert_allclose(point.xyz, points.positions[0])


def test_the_rail_is_the_papers():
    cameras = rail.cameras("rail", 76, 800, 533)
    centres = np.array([camera.centre for camera in cameras])
    assert np.linalg.norm(centres[-1] - centres[0]) == pytest.approx(0.420)
    assert np.linalg.matrix_rank(centres - centres[0], tol=1e-9) == 1
    target = centres[[0, -1]] - np.array([0, -rail.TARGET[2], 0])
    cosine = target[0] @ target[1] / np.prod(np.linalg.norm(target, axis=1))
    assert np.degrees(np.arccos(cosine)) == pytest.approx(36.6, abs=0.1)
    for camera in cameras[::15]:
        x, y, z = camera.rotation @ np.array([0, -rail.TARGET[2], 0]) + camera.translation
        np.testing.assert_allclose([x, y], 0.0, atol=1e-12)  # all look at the ball
        assert z > 0
        assert camera.rotation[1] @ [0, 1, 0] > 0  # upright: the world's down is down in the photo
