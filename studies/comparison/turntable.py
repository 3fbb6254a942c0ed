"""Moving pictures of twins: a camera that swings around the object as far as the photos did, or once around it.

The path is smooth and closed, so that the movie has no cut: to and fro over the directions that photos
were taken from, or a full turn where they stand all around. Frames are sRGB, as rendered.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ...core.errors import DgsError
from ...core.files import replacing
from ...core.formats.ply import read_ply
from ...core.gaussians import Gaussians
from ...core.pipeline.views import Viewer, to_pixels
from ...core.pose import Pose
from ...core.reconstruction import Reconstruction
from ...core.training.scale import scene_scale

Array = NDArray[np.float64]

FRAMES, QUICK_FRAMES, FRAME_MS = 36, 12, 90
#: Widths (px) of one twin's movie and of each of several side by side; what a movie may weigh.
WIDTH, SIDE_WIDTH, MOST_BYTES = 480, 320, 3_000_000
#: No gap between two cameras' azimuths larger than this (degrees): they stand all around.
_AROUND = 60.0
#: How much the point that all cameras look at is drawn to the middle of the points (parallel axes have no such point).
_DRAW = 0.01


@dataclass(frozen=True)
class CameraPath:
    """The movie's cameras.

    Attributes:
        poses: closed, one per frame.
        degrees: how far it swings, 360 for a full turn.
    """

    poses: list[Pose]
    degrees: float


@dataclass(frozen=True)
class ShownTwin:
    """A twin on disk: what movies call it, its PLY, and the sRGB colour behind it."""

    title: str
    file: Path
    background: tuple[float, float, float]


def camera_path(cameras: Reconstruction, frames: int = FRAMES) -> CameraPath:
    """A smooth closed path at the cameras' own distance and height, looking at what they look at."""
    poses = list(cameras.poses.values())
    centres = np.array([pose.centre for pose in poses])
    target = _looked_at(cameras)
    up = np.sum([-pose.rotation[1] for pose in poses], axis=0)
    up /= np.linalg.norm(up)
    offsets = centres - target
    heights = offsets @ up
    flat = offsets - heights[:, None] * up
    distances = np.linalg.norm(flat, axis=1)
    front = flat.sum(axis=0)
    if np.linalg.norm(front) < 0.05 * distances.sum():  # all around: any start will do
        front = flat[0]
    front /= np.linalg.norm(front)
    side = np.cross(up, front)
    azimuths = np.arctan2(flat @ side, flat @ front)
    turn = np.arange(frames) / frames * 2 * np.pi
    gaps = np.diff(np.sort(azimuths), append=np.sort(azimuths)[0] + 2 * np.pi)
    if np.degrees(gaps.max()) < _AROUND:
        angles, degrees = turn, 360.0
        height, distance = np.full(frames, np.median(heights)), np.full(frames, np.median(distances))
    else:
        low, high = np.percentile(azimuths, [2, 98])
        angles, degrees = (low + high) / 2 + (high - low) / 2 * np.sin(turn), float(np.degrees(high - low))
        height, distance = (_along(azimuths, values, angles) for values in (heights, distances))
    places = (
        target
        + height[:, None] * up
        + distance[:, None] * (np.cos(angles)[:, None] * front + np.sin(angles)[:, None] * side)
    )
    return CameraPath([_looking(place, target, up) for place in places], degrees)


def viewer_of(twin: ShownTwin, cameras: Reconstruction) -> Viewer:
    """Renders a twin on disk as photos of the set would see it."""
    scale = scene_scale(list(cameras.cameras().values()), cameras.points)
    return Viewer(Gaussians.from_cloud(read_ply(twin.file)), scale, "cpu", background=twin.background)


def frames_of(twin: ShownTwin, cameras: Reconstruction, path: CameraPath) -> list[Image.Image]:
    """Renders a twin along the path with the first photo's lens, at the photos' size."""
    viewer = viewer_of(twin, cameras)
    lens = next(iter(cameras.lenses.values()))
    drawn: dict[bytes, Image.Image] = {}  # to and fro: half of the frames come twice
    out = []
    for pose in path.poses:
        key = pose.centre.round(9).tobytes()
        if key not in drawn:
            drawn[key] = Image.fromarray(to_pixels(viewer.sharp(lens, pose)))
        out.append(drawn[key])
    return out


def write_movies(
    out: Path, twins: Mapping[str, ShownTwin], beside: Sequence[str], cameras: Reconstruction, frames: int = FRAMES
) -> dict[str, str]:
    """Writes turntable_NAME.mp4 (or .gif) for every twin, and turntable.gif with those of `beside` side by side.

    Args:
        twins: by short name.

    Returns:
        Title by file name.
    """
    path = camera_path(cameras, frames)
    how = f"{path.degrees:.0f} degrees" if path.degrees < 360 else "a full turn"
    rendered = {name: frames_of(twin, cameras, path) for name, twin in twins.items()}
    written: dict[str, str] = {}
    shown = [name for name in beside if name in rendered]
    if len(shown) > 1:
        rows = [
            _beside([_titled(_scaled(rendered[name][i], SIDE_WIDTH), twins[name].title) for name in shown])
            for i in range(frames)
        ]
        write_gif(out / "turntable.gif", rows)
        written["turntable.gif"] = f"The twins side by side, {how}: " + " | ".join(twins[name].title for name in shown)
    for name, pictures in rendered.items():
        file, small = f"turntable_{name}.mp4", [_scaled(picture, WIDTH) for picture in pictures]
        if not write_mp4(out / file, small):
            file = f"turntable_{name}.gif"
            write_gif(out / file, small)
        written[file] = f"{twins[name].title}, {how}"
    return written


def write_mp4(path: Path, frames: Sequence[Image.Image], turns: int = 3) -> bool:
    """Writes an H.264 movie that goes round `turns` times; False where this Python has no encoder for it."""
    try:
        import av  # late: not everywhere
    except ImportError:
        return False
    if "libx264" not in av.codecs_available:
        return False
    width, height = (side // 2 * 2 for side in frames[0].size)  # colour is stored at half the resolution
    with replacing(path) as temporary, av.open(str(temporary), "w", format="mp4") as film:
        stream = film.add_stream("libx264", rate=round(1000 / FRAME_MS), options={"crf": "20", "preset": "slow"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for frame in [*frames] * turns:
            film.mux(stream.encode(av.VideoFrame.from_image(frame.crop((0, 0, width, height)))))
        film.mux(stream.encode())
    return True


def write_gif(path: Path, frames: Sequence[Image.Image], most: int = MOST_BYTES) -> None:
    """Writes a looping GIF; colours, then size, give way until it weighs less than `most` bytes."""
    for share, colours in ((1.0, 128), (1.0, 64), (0.85, 64), (0.7, 64), (0.6, 48), (0.45, 32)):
        with replacing(path) as temporary:
            small = [_scaled(frame, round(frame.width * share)) for frame in frames]
            few = [frame.quantize(colours, dither=Image.Dither.NONE) for frame in small]
            few[0].save(temporary, "GIF", save_all=True, append_images=few[1:], duration=FRAME_MS, loop=0)
        if path.stat().st_size < most:
            return


def _looked_at(cameras: Reconstruction) -> Array:
    """[3] the point nearest to all optical axes."""
    middle = np.median(cameras.points.positions, axis=0)
    total, right = np.zeros((3, 3)), np.zeros(3)
    for pose in cameras.poses.values():
        axis = pose.rotation[2]
        across = np.eye(3) - np.outer(axis, axis)
        total += across + _DRAW * np.eye(3)
        right += across @ pose.centre + _DRAW * middle
    if not np.isfinite(right).all():
        raise DgsError("The cameras are not finite", "Check the camera model")
    return np.linalg.solve(total, right)


def _along(azimuths: Array, values: Array, at: Array) -> Array:
    """Smoothly what the cameras do over their azimuth: a parabola is what a straight rail looks like."""
    degree = min(2, len(azimuths) - 1)
    return np.polyval(np.polyfit(azimuths, values, degree), at) if np.ptp(azimuths) > 1e-6 else values.mean() + 0 * at


def _looking(place: Array, target: Array, up: Array) -> Pose:
    forward = (target - place) / np.linalg.norm(target - place)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Pose(rotation, -rotation @ place)


def _scaled(picture: Image.Image, width: int) -> Image.Image:
    size = (min(width, picture.width), round(picture.height * min(width, picture.width) / picture.width))
    return picture if size == picture.size else picture.resize(size, Image.Resampling.LANCZOS)


def _titled(picture: Image.Image, title: str) -> Image.Image:
    picture = picture.copy()
    draw: Any = ImageDraw.Draw(picture)
    font = ImageFont.load_default(13)
    draw.text((6, 4), title, fill="white", stroke_width=2, stroke_fill="black", font=font)
    return picture


def _beside(pictures: Sequence[Image.Image]) -> Image.Image:
    gap = 4
    row = Image.new("RGB", (sum(one.width + gap for one in pictures) - gap, pictures[0].height), "white")
    left = 0
    for one in pictures:
        row.paste(one, (left, 0))
        left += one.width + gap
    return row
