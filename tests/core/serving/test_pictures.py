"""Pictures of twins in shared memory are those of the engine, wherever the twins stand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.cloud import GaussianCloud
from dgs.core.colour import linear_to_srgb
from dgs.core.errors import PsfError
from dgs.core.formats.turning import moved
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.lens import Lens
from dgs.core.pipeline.views import Viewer
from dgs.core.pose import Pose
from dgs.core.serving.messages import Blur, PlacedTwin, SharedTwin, View
from dgs.core.serving.picture import draw
from dgs.core.serving.shared_area import SharedArea
from dgs.core.serving.stage import Stage, carried
from dgs.core.serving.through import point_spread
from dgs.core.training.scale import scene_scale
from dgs.core.views import SparsePoints

CAMERA = Camera("view", 96, 80, 110.0, 110.0, 48.0, 40.0, np.eye(3), np.zeros(3))
STEP = 1.01 / 255


def crowd(count: int = 400, harmonics: int = 16) -> GaussianCloud:
    random = np.random.default_rng(3)
    return GaussianCloud(
        (random.uniform(-1.3, 1.3, (count, 3)) + [0, 0, 5]).astype(np.float32),
        np.log(random.uniform(0.03, 0.3, (count, 3))).astype(np.float32),
        random.normal(size=(count, 4)).astype(np.float32),
        random.uniform(-2.0, 3.0, count).astype(np.float32),
        random.normal(size=(count, harmonics, 3)).astype(np.float32) * np.float32(0.4),
    )


def turn(axis: list[float], angle: float) -> np.ndarray:
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def whole(linear: np.ndarray, place: list[float]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, place
    return matrix


def put(stage: Stage, key: str, cloud: GaussianCloud) -> None:
    twin = SharedTwin(key, len(cloud), cloud.sh.shape[1])
    planes = twin.planes(memoryview(bytearray(twin.bytes)))
    unit = cloud.quaternions / np.linalg.norm(cloud.quaternions, axis=1, keepdims=True)
    base = np.concatenate([cloud.sh[:, 0], 1 / (1 + np.exp(-cloud.opacity_logits[:, None]))], axis=1)
    rest = (cloud.sh[:, i] for i in range(1, cloud.sh.shape[1]))
    for plane, values in zip(planes, (cloud.means, np.exp(cloud.log_scales), unit, base, *rest), strict=True):
        plane[:] = values
    stage.put(twin, planes)


def picture(
    clouds: dict[str, tuple[GaussianCloud, np.ndarray]], camera: Camera = CAMERA, choice: dict | None = None, **options
):
    """Pixels [H, W, 4] and depths, rows downwards."""
    stage, area = Stage(), SharedArea.create()
    for key, (cloud, _) in clouds.items():
        put(stage, key, cloud)
    placed = tuple(PlacedTwin(key, tuple(matrix.reshape(16)), **(choice or {})) for key, (_, matrix) in clouds.items())
    drawn = draw(stage, View(placed, camera, **options), area)
    pixels, depth = drawn.planes(area.view(drawn.bytes))
    return pixels[::-1].copy(), None if depth is None else depth[::-1].copy()


def alone(cloud: GaussianCloud, **options):
    return picture({"a": (cloud, np.eye(4))}, **options)


def viewer(cloud: GaussianCloud) -> tuple[Viewer, Lens, Pose]:
    """What `run_dgs.py render` draws with."""
    points = SparsePoints(cloud.means.astype(np.float64), np.zeros(cloud.means.shape, np.uint8))
    lens = Lens("PINHOLE", 96, 80, (110.0, 110.0, 48.0, 40.0))
    return Viewer(Gaussians.from_cloud(cloud), scene_scale([CAMERA], points), "cpu"), lens, Pose(np.eye(3), np.zeros(3))


def test_they_are_the_engines_own_over_a_colour_and_over_nothing() -> None:
    cloud = crowd()
    render, lens, pose = viewer(cloud)
    wanted = render.degraded(lens, pose, Medium(None), "view").transpose(1, 2, 0)
    seen, _ = alone(cloud, background=(0.0, 0.0, 0.0))
    assert wanted.std() > 0.1 and np.abs(seen[..., :3] - wanted).max() < 1e-4 and (seen[..., 3] == 1).all()
    light, depth = alone(cloud, background=(0.0, 0.0, 0.0), light=True, depth=True)
    assert np.abs(linear_to_srgb(light[..., :3]) - wanted).max() < 1e-4 and depth.shape == (80, 96)
    straight = render.transparent(lens, pose, Medium(None), "view").transpose(1, 2, 0)
    clear, _ = alone(cloud)
    assert np.abs(clear[..., 3] - straight[..., 3]).max() < 1e-4
    # (a file's colours end at white)
    assert np.abs(np.minimum(clear[..., :3], clear[..., 3:]) - straight[..., :3] * straight[..., 3:]).max() < 1e-3
    lit, _ = alone(cloud, light=True)
    solid = lit[..., 3] > 0.05
    other, _ = alone(cloud, light=True, power=2.2)
    part = clear[..., 3:].clip(1e-3)
    assert np.abs((other[..., :3] / part) ** (1 / 2.2) * part - clear[..., :3]).max() < 1e-3
    encoded = linear_to_srgb(lit[solid, :3] / lit[solid, 3:]).clip(0, 1)
    assert np.abs(encoded - straight[solid, :3]).max() < STEP


def test_a_twin_may_be_moved_turned_and_scaled_and_looks_the_same_from_there() -> None:
    cloud, place = crowd(), whole(2.5 * turn([1, 2, 3], 1.1), [4, -1, 7])
    rotation = CAMERA.rotation @ turn([1, 2, 3], 1.1).T
    before = CAMERA.moved(CAMERA.rotation, np.array([0.2, -0.1, 0.3]))
    camera = CAMERA.moved(rotation, 2.5 * before.translation - rotation @ place[:3, 3])
    here, near = alone(cloud, camera=before, depth=True)
    there, far = picture({"a": (cloud, place)}, camera, depth=True)
    assert np.abs(here - there).max() < 1e-4
    seen = here[..., 3] > 0.1
    assert np.allclose(far[seen], 2.5 * near[seen], rtol=1e-4) and near[seen].min() > 3 and near[seen].max() < 7


def test_twins_among_each_other_are_one_picture_harmonics_too() -> None:
    """One half was moved away, turned and scaled in its own axes, and is put back by its object's matrix."""
    cloud, rotation = crowd(), turn([1, -1, 2], 2.0)
    half = np.arange(len(cloud)) % 2 == 0
    parts = [
        GaussianCloud(*(getattr(cloud, n)[m] for n in ("means", "log_scales", "quaternions", "opacity_logits", "sh")))
        for m in (half, ~half)
    ]
    away = moved(parts[1], rotation, 0.5, np.array([3.0, 1.0, -2.0]))
    back = np.linalg.inv(whole(0.5 * rotation, [3, 1, -2]))
    wanted, _ = alone(cloud)
    seen, _ = picture({"a": (parts[0], np.eye(4)), "b": (away, back)})
    assert np.abs(seen - wanted).max() < 2e-3
    wrong, _ = picture({"a": (parts[0], np.eye(4)), "b": (away, np.eye(4))})
    assert np.abs(wrong - wanted).max() > 0.3


def test_a_mirrored_twin_is_the_mirrored_picture() -> None:
    cloud = crowd()
    wanted, _ = alone(cloud)
    seen, _ = picture({"a": (cloud, np.diag([-1.0, 1.0, 1.0, 1.0]))})
    assert np.abs(seen[:, ::-1] - wanted).max() < 2e-3


def test_an_uneven_scale_stretches_shapes() -> None:
    cloud = crowd(50, 1)
    linear = np.diag([2.0, 0.5, 1.2]) @ turn([1, 1, 0], 0.7)
    out = carried(cloud, whole(linear, [1, 2, 3]))

    def covariances(c: GaussianCloud) -> np.ndarray:
        rotations = np.array([_rotation(q) for q in c.quaternions.astype(float)])
        spread = rotations * np.exp(c.log_scales.astype(float))[:, None, :]
        return spread @ spread.transpose(0, 2, 1)

    assert np.allclose(covariances(out), linear @ covariances(cloud) @ linear.T, rtol=1e-4, atol=1e-6)
    assert np.allclose(out.means, cloud.means @ linear.T + [1, 2, 3], atol=1e-5)


def _rotation(q: np.ndarray) -> np.ndarray:
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_size_opacity_number_and_box_count() -> None:
    cloud = crowd()

    def of(kept: np.ndarray) -> GaussianCloud:
        return GaussianCloud(*(a[kept] for a in (*vars(cloud).values(),)))

    opacity, inside = 1 / (1 + np.exp(-cloud.opacity_logits)), np.abs(cloud.means - [0.2, 0, 5]).max(axis=1) <= 0.8
    box = np.linalg.inv(whole(0.8 * np.eye(3), [0.2, 0, 5]))
    cases = (
        ({"size": 0.5}, replace(cloud, log_scales=cloud.log_scales + np.float32(np.log(0.5)))),
        ({"faintest": 0.6}, of(opacity >= 0.6)),
        ({"most": 100}, of(np.arange(400) % 4 == 3)),
        ({"box": tuple(box.reshape(16))}, of(inside)),
    )
    plain, _ = alone(cloud)
    for choice, wanted in cases:
        seen, _ = alone(cloud, choice=choice)
        assert np.abs(seen - alone(wanted)[0]).max() < 1e-4, choice
        assert np.abs(seen - plain).max() > 0.1, choice


@pytest.mark.parametrize("choice", [{"size": 0.0}, {"faintest": 1.0}, {"most": 0}])
def test_where_nothing_is_left_the_background_is_seen(choice) -> None:
    seen, depth = alone(crowd(), choice=choice, background=(0.2, 0.5, 1.0), light=True, depth=True)
    assert np.abs(linear_to_srgb(seen[3, 4, :3]) - [0.2, 0.5, 1.0]).max() < 1e-4 and (depth == 1e10).all()
    behind = CAMERA.moved(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    assert not alone(crowd(), camera=behind)[0].any()


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_through_the_medium_it_is_the_engines_own_too(space: str) -> None:
    cloud, blur = crowd(), Blur("gaussian:2,4,30", space)
    render, lens, pose = viewer(cloud)
    medium = Medium(parse_psf(blur.psf), space)
    sharp, near = alone(cloud, background=(0.0, 0.0, 0.0), depth=True)
    seen, depth = alone(cloud, background=(0.0, 0.0, 0.0), blur=blur, depth=True)
    wanted = render.degraded(lens, pose, medium, "view").transpose(1, 2, 0)
    assert np.abs(seen[..., :3] - wanted).max() < 1e-4 and np.abs(seen - sharp).max() > 0.2
    assert np.allclose(depth, near, rtol=1e-4), "depths are those of the sharp picture"
    straight = render.transparent(lens, pose, medium, "view").transpose(1, 2, 0)
    clear, deep = alone(cloud, blur=blur, depth=True)
    assert np.abs(clear[..., 3] - straight[..., 3]).max() < 1e-4
    assert np.abs(clear[..., :3] - straight[..., :3] * straight[..., 3:]).max() < 1e-3
    there = (near < 1e9) & (clear[..., 3] > 1e-3)
    assert np.allclose(deep[there], near[there], rtol=1e-4) and there.mean() > 0.5


@pytest.mark.parametrize("step", [0.5, 2.0])
def test_a_medium_is_as_wide_in_a_larger_and_a_smaller_picture(step: float, tmp_path: Path) -> None:
    """Of the scene, not of the picture: a Gaussian, and a kernel of samples that is the same one."""
    psf = parse_psf("gaussian:4,6,20")
    assert psf is not None
    np.save(tmp_path / "kernel.npy", psf.kernel())
    wanted = replace(psf, sigma_x=4 / step, sigma_y=6 / step)
    for text in ("gaussian:4,6,20", f"file:{tmp_path / 'kernel.npy'}"):
        found = point_spread(Blur(text, "srgb", step))
        assert found is not None and np.allclose(found.covariance, wanted.covariance, rtol=0.03)
        rows, columns = found.kernel().shape
        assert rows % 2 == columns % 2 == 1 and abs(found.kernel().sum() - 1) < 1e-6
    half = View((), CAMERA, blur=Blur("gaussian:4")).resized(48, 40)
    assert half.blur is not None and half.blur.step == 2.0 and View.parse(half.message()).blur == half.blur
    assert point_spread(Blur("none")) is None and point_spread(Blur("gaussian:0")) is None
    with pytest.raises(PsfError, match="px of this picture"):
        point_spread(Blur("gaussian:9", "srgb", 0.01))
