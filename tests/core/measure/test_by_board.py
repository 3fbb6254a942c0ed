"""The scale of printed markers: drawn by cameras that are known, found again, and held against what was drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from dgs.command_line import run
from dgs.core.camera import Camera
from dgs.core.errors import Cancelled, DgsError
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.measure.boards import parsed_board
from dgs.core.measure.by_board import BoardScale, board_scale, fitted
from dgs.core.measure.markers import CHESS, FoundCorners, found_corners
from dgs.core.measure.printed import picture_of, sheet_of
from dgs.core.measure.sights import Sight, Sights
from dgs.core.measure.tables import as_plain, lines
from dgs.core.progress import Silent
from dgs.core.training.scale import SceneScale
from dgs.studies.stability.fuzzed_state import write_twin
from scipy.ndimage import gaussian_filter

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
#: Scene units for each mm of the print, and how far from it the cameras stand.
UNITS, DISTANCE = 0.004, 1.6
LOOSE, CHESSBOARD = "aruco:4x4_50,60mm,0-3", "charuco:4x4_50,4x3,60mm,48mm"
DOTS = 6 * 25.4  # px of the drawn print for each inch


def camera(name: str, aside: float) -> Camera:
    """Looks at the world's origin from `aside` degrees beside the z axis."""
    angle = np.radians(aside)
    centre = DISTANCE * np.array([np.sin(angle), 0.1 * np.cos(3 * angle), -np.cos(angle)])
    forward = -centre / np.linalg.norm(centre)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Camera(name, WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, rotation, -rotation @ centre)


CAMERAS = {f"{index}.png": camera(f"{index}.png", aside) for index, aside in enumerate((-25, -12, 3, 14, 27))}


def drawn(board: str, one: Camera, grow: int = 0) -> np.ndarray:
    """[H, W] grey in [0, 1] of a print that lies about the origin in z = 0.

    Args:
        grow: px of the print (a sixth of a mm) that its ink has spread.
    """
    sheet = sheet_of(parsed_board(board))
    print_ = picture_of(sheet, DOTS)
    if grow:
        print_ = cv2.erode(print_, np.ones((2 * grow + 1, 2 * grow + 1), np.uint8))
    mm = UNITS * 25.4 / DOTS
    over = 4  # px of the drawing for each px of the photo
    to_world = np.array([[mm, 0, -sheet.width / 2 * UNITS], [0, mm, -sheet.height / 2 * UNITS], [0, 0, 1.0]])
    plane = np.stack([one.rotation[:, 0], one.rotation[:, 1], one.translation], axis=1)
    lens = np.array([[over * one.fx, 0, over * one.cx], [0, over * one.fy, over * one.cy], [0, 0, 1.0]])
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])  # OpenCV counts from the middle of the first px
    matrix = np.linalg.inv(half) @ lens @ plane @ to_world @ half
    size = (over * WIDTH, over * HEIGHT)
    large = cv2.warpPerspective(print_, matrix, size, flags=cv2.INTER_AREA, borderValue=150)
    grey = cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0
    noise = np.random.default_rng(int(one.name[0])).standard_normal(grey.shape)
    return (0.1 + 0.75 * grey + 0.004 * noise).astype(np.float32)


def sights(images: dict[str, np.ndarray], blur: float = 0.0) -> Sights:
    empty = np.zeros((3, HEIGHT, WIDTH), np.float32)
    found = {
        name: Sight(one, np.ones((HEIGHT, WIDTH), np.float32), empty, np.stack([images[name]] * 3), blur)
        for name, one in CAMERAS.items()
    }
    return Sights(found, SceneScale(np.zeros(3), 2.0), 0.01)


def searched(
    board: str, printed: str = "", sigma: float = 0.0, given: str = "none", **more: Any
) -> tuple[Any, Any, Any, float, Any]:
    """Arguments of `board_scale`: photos of what was `printed`, blurred, of a twin whose medium is `given`."""
    sharp = {name: drawn(printed or board, one, **more) for name, one in CAMERAS.items()}
    photos = {name: gaussian_filter(image, sigma) if sigma else image for name, image in sharp.items()}
    views = [
        SimpleNamespace(name=name, planes=lambda image=image: np.stack([image] * 3)) for name, image in photos.items()
    ]
    twin: Any = SimpleNamespace(medium=Medium(parse_psf(given)), views=views)
    return parsed_board(board), twin, sights(sharp, sigma), 0.0, Silent()


def off(scale: BoardScale) -> float:
    """Share that a scale is too large by."""
    return scale.size * UNITS - 1.0


@pytest.fixture(scope="module")
def loose() -> BoardScale:
    return board_scale(*searched(LOOSE))


@pytest.fixture(scope="module")
def corners() -> dict[str, FoundCorners]:
    return {name: found_corners(parsed_board(LOOSE), drawn(LOOSE, one)) for name, one in CAMERAS.items()}


def test_loose_markers_give_the_scale(loose: BoardScale) -> None:
    assert abs(off(loose)) < 0.003 and abs(off(loose)) < 1.96 * loose.deviation / loose.size
    assert (loose.markers, loose.corners, loose.photos, loose.pictures) == (4, 16, 5, "photos")
    assert loose.residual_px < 0.1 and loose.residual < 0.2 and loose.left_out == 0


def test_a_chessboard_gives_the_scale() -> None:
    found = board_scale(*searched(CHESSBOARD))
    assert abs(off(found)) < 0.002 and abs(off(found)) < 1.96 * found.deviation / found.size
    assert (found.markers, found.corners, found.photos) == (6, 6, 5)


def test_corners_lie_where_they_were_drawn(corners: dict[str, FoundCorners]) -> None:
    sheet = sheet_of(parsed_board(LOOSE))
    x, y = 15.0 - sheet.width / 2, 15.0 - sheet.height / 2  # the first marker's upper left one, mm
    for name, one in CAMERAS.items():
        a, b, c = one.rotation @ (UNITS * np.array([x, y, 0.0])) + one.translation
        true = (FOCAL * a / c + WIDTH / 2, FOCAL * b / c + HEIGHT / 2)
        assert np.allclose(corners[name].corners[0, 0], true, atol=0.15), name


def test_ink_that_spreads_is_taken_off(loose: BoardScale) -> None:
    """3 px of the print to every side make a marker 1.7 % larger."""
    spread = board_scale(*searched(LOOSE, grow=3))
    assert abs(off(spread) - off(loose)) < 0.004


def test_through_a_blur_photos_are_sharpened_and_unseen_blurs_leave_the_renders() -> None:
    found = board_scale(*searched(LOOSE, sigma=2.5, given="gaussian:2.5"))
    assert found.pictures == "sharpened" and abs(off(found)) < 0.01
    assert abs(off(found)) < 1.96 * found.deviation / found.size
    wide = board_scale(*searched(LOOSE, sigma=9.0, given="gaussian:9"))
    assert wide.pictures == "renders" and abs(off(wide)) < 0.01


def test_what_was_printed_less_exactly_is_known_less_exactly(loose: BoardScale) -> None:
    board, *rest = searched(LOOSE.replace("60mm", "60+-1.2mm"), LOOSE)
    rough = board_scale(board, *rest)
    assert np.isclose(rough.deviation / rough.size, np.hypot(0.02, loose.deviation / loose.size), rtol=1e-3)


def test_a_wrong_point_and_a_wrong_corner_are_left_out(corners: dict[str, FoundCorners], loose: BoardScale) -> None:
    board, _, views, *_ = searched(LOOSE)
    x, y = corners["0.png"].corners[1, 2]
    wild = {**corners, "0.png": replace(corners["0.png"], corners={**corners["0.png"].corners, (1, 2): (x + 9, y)})}
    found = fitted(board, wild, views, 0.0, 0.0)
    assert found.left_out == 1 and abs(off(found) - off(loose)) < 0.001
    moved = {  # as if this corner lay elsewhere on the print
        name: replace(one, corners={**one.corners, (2, 0): tuple(np.mean([one.corners[2, i] for i in (0, 1)], axis=0))})
        for name, one in corners.items()
    }
    found = fitted(board, moved, views, 0.0, 0.0)
    assert found.left_out == 1 and found.corners == 15 and abs(off(found) - off(loose)) < 0.004


def test_where_cameras_look_counts(corners: dict[str, FoundCorners]) -> None:
    board, _, views, *_ = searched(LOOSE)
    sure, unsure = (fitted(board, corners, views, px, 0.0) for px in (0.0, 3.0))
    assert unsure.deviation > 1.5 * sure.deviation


@pytest.mark.parametrize(
    ("board", "printed", "why"),
    [
        ("aruco:6x6_50,60mm", LOOSE, r"No marker of 'aruco:6x6_50,60mm' is found on 5 photos\. Check its dictionary"),
        ("charuco:4x4_50,4x3,60mm,40mm", CHESSBOARD, "Measure both on the print"),
        ("charuco:4x4_50,3x4,60mm,48mm", CHESSBOARD, "."),
    ],
)
def test_what_is_not_there_or_is_another_print_is_refused(board: str, printed: str, why: str) -> None:
    with pytest.raises(DgsError, match=why) as caught:
        board_scale(*searched(board, printed))
    assert "\n" not in str(caught.value)


def some(found: dict[str, FoundCorners], **kept: Any) -> dict[str, FoundCorners]:
    return {name: replace(one, **kept) if name != "0.png" else one for name, one in found.items()}


def test_one_photo_two_sizes_and_a_number_twice_are_refused(corners: dict[str, FoundCorners]) -> None:
    board, _, views, *_ = searched(LOOSE)
    with pytest.raises(DgsError, match="only on 1, such as '0.png'.*from different sides"):
        fitted(board, some(corners, corners={}), views, 0.0, 0.0)
    smaller = {}
    for name, one in corners.items():
        four = {
            (marker, index): tuple(0.7 * np.array(one.corners[marker, index]) + 0.3 * np.array(one.corners[marker, 0]))
            for marker in (0, 1)
            for index in range(4)
        }
        smaller[name] = replace(one, corners={**one.corners, **four}, spread={})
    with pytest.raises(DgsError, match=r"not of one size: number [01] is 0\.7.*Name those of 60 mm alone"):
        fitted(board, smaller, views, 0.0, 0.0)
    twice = {name: FoundCorners({}, frozenset({3})) for name in corners}
    with pytest.raises(DgsError, match="Marker 3 is on one photo more than once. Print each number once"):
        fitted(board, twice, views, 0.0, 0.0)


def test_a_marker_that_moves_between_photos_meets_nowhere(corners: dict[str, FoundCorners]) -> None:
    board, _, views, *_ = searched(LOOSE)
    random = np.random.default_rng(0)
    moved = {
        name: FoundCorners({corner: tuple(random.uniform(0, 200, 2)) for corner in one.corners})
        for name, one in corners.items()
    }
    with pytest.raises(DgsError, match="meet nowhere|not of one size|two photos"):
        fitted(board, moved, views, 0.0, 0.0)


def test_a_marker_that_a_photo_shows_twice_is_not_used() -> None:
    image = np.full((200, 400), 0.9, np.float32)
    marker = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 5, 90) / 255.0
    image[50:140, 50:140] = image[50:140, 250:340] = marker
    found = found_corners(parsed_board("aruco:40mm"), image)
    assert found.twice == {5} and found.corners == {}
    assert found_corners(parsed_board("aruco:40mm"), image[:, :200]).corners.keys() == {(5, i) for i in range(4)}
    assert found_corners(parsed_board("aruco:40mm,6-9"), image[:, :200]).corners == {}
    assert CHESS not in {name for name, _ in found.corners}


def test_it_can_be_stopped() -> None:
    board, twin, views, cameras, _ = searched(LOOSE)
    stopping: Any = Silent()
    stopping.cancelled = lambda: True
    with pytest.raises(Cancelled):
        board_scale(board, twin, views, cameras, stopping)


def test_what_is_said_and_written(loose: BoardScale) -> None:
    plain = loose.plain(2.0)
    assert np.isclose(plain["size"], loose.size / 2) and plain["unit"] == "mm" and plain["board"] == LOOSE
    assert "4 markers on 5 photos (as they are)" in loose.sentence()
    findings: Any = SimpleNamespace(measures=(), places={}, missing={}, noise=0.1, scale=plain, said=loose.sentence())
    assert as_plain(findings)["scale"] == plain and lines(findings) == [loose.sentence()]
    draws = loose.drawn(4000, np.random.default_rng(0))
    assert draws[0] == loose.size and np.isclose(draws[1:].std(), loose.deviation, rtol=0.05)


def test_the_command_says_that_a_twin_shows_no_board(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_twin(tmp_path)
    points = tmp_path / "points.json"
    points.write_text('{"measures": []}')
    assert run(["measure", str(tmp_path / "twin"), str(points), "--board", "aruco:40mm", "--progress", "none"]) == 2
    assert "No marker of 'aruco:40mm' is found" in capsys.readouterr().err
    assert run(["measure", str(tmp_path / "twin"), str(points), "--board", "aruco", "--progress", "none"]) == 2
    assert "Write aruco:" in capsys.readouterr().err
