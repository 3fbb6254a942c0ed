"""Synthetic photo sets whose image formation is known: what the inspection of photos is validated on.

A small ray caster (numpy; exact depth, nothing of the rasterizer in it) draws textured cards, spheres, a floor and a
wall in linear light, 3 x 3 rays a pixel, with a margin around the frame. `degrade` then does to the light what a
medium and a camera do: haze by depth, blur, gains, vignetting, clipping, noise, the sRGB curve, 8 bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from dgs.core.camera import Camera
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.formats.colmap import write_model
from dgs.core.views import SparsePoints
from PIL import Image
from scipy import ndimage

WIDTH, HEIGHT, MARGIN, VIEWS, FINER = 384, 256, 24, 12, 3
TEXTURE = 768


@dataclass
class Scene:
    """Light and depth of all views.

    Attributes:
        cameras: of the frames without margin.
        light: [V, H + 2m, W + 2m, 3] float32, linear.
        depth: [V, H + 2m, W + 2m] float32, along the optical axis.
        points: on the surfaces, seen by at least one camera.
    """

    cameras: list[Camera]
    light: np.ndarray = field(repr=False)
    depth: np.ndarray = field(repr=False)
    points: SparsePoints = field(repr=False)


@dataclass(frozen=True)
class Truth:
    """What a set went through; zeros are off.

    Attributes:
        psf: (sigma_x, sigma_y, angle) px, px, degrees; space: what it blurs, 'linear' or 'srgb'.
        defocus: px of standard deviation at the scene's nearest and farthest, sharp in the middle of 1 / depth.
        field: px of standard deviation that the corners have beyond the middle.
        own: (least, most) px of standard deviation of each photo's own round blur, besides `psf`.
        motion: px, mean length of each photo's own straight path.
        haze: optical depth (attenuation times the median depth).
        exposure, white_balance: standard deviation of the photos' gains (natural log).
        vignetting: share of the light lost in the corners.
        noise: standard deviation in 8-bit steps.
        saturation: share of px that are clipped.
        gloss: height of a highlight, relative to white.
    """

    psf: tuple[float, float, float] = (0.0, 0.0, 0.0)
    space: str = "linear"
    defocus: float = 0.0
    field: float = 0.0
    own: tuple[float, float] = (0.0, 0.0)
    motion: float = 0.0
    haze: float = 0.0
    exposure: float = 0.0
    white_balance: float = 0.0
    vignetting: float = 0.0
    noise: float = 0.0
    saturation: float = 0.0
    gloss: float = 0.0


def dead_leaves(random: np.random.Generator, size: int = TEXTURE) -> np.ndarray:
    """[size, size, 3] float32 albedo: discs of all sizes over one another, as occluding things in the world."""
    hue = random.uniform(0.15, 0.75, 3)
    picture = np.broadcast_to(hue.astype(np.float32), (size, size, 3)).copy()
    radii = np.sort(1.0 / random.uniform(1 / 90.0**2, 1 / 2.5**2, 7000) ** 0.5)[::-1]
    for r in random.permutation(radii):
        x, y = random.uniform(0, size, 2)
        x0, x1, y0, y1 = (int(max(0, v)) for v in (x - r, x + r + 2, y - r, y + r + 2))
        yy, xx = np.mgrid[y0 : min(y1, size), x0 : min(x1, size)]
        inside = (xx - x) ** 2 + (yy - y) ** 2 < r * r
        shade = random.uniform(0.06, 0.85) * (0.75 + 0.25 * random.uniform(-1, 1, 3))
        picture[yy[inside], xx[inside]] = shade
    return picture


def make_scene(
    seed: int, gloss: float = 0.0, width: int = WIDTH, height: int = HEIGHT, views: int = VIEWS, finer: int = FINER
) -> Scene:
    """One scene and its views; the same seed gives the same bits. `finer` rays along each side of a pixel."""
    random = np.random.default_rng([seed, 77])
    textures = [dead_leaves(random) for _ in range(3)]
    spheres = [
        (
            np.array([random.uniform(-1.6, 1.6), random.uniform(-0.6, 0.5), random.uniform(3.0, 6.5)]),
            random.uniform(0.3, 0.8),
            int(random.integers(3)),
        )
        for _ in range(int(random.integers(2, 5)))
    ]
    cards = []
    for _ in range(int(random.integers(3, 6))):
        normal = np.array([random.uniform(-0.6, 0.6), random.uniform(-0.5, 0.5), -1.0])
        normal /= np.linalg.norm(normal)
        across = np.cross([0.0, 1.0, 0.0], normal)
        across /= np.linalg.norm(across)
        cards.append(
            (
                np.array([random.uniform(-2, 2), random.uniform(-1.0, 0.6), random.uniform(2.6, 7.0)]),
                normal,
                across,
                random.uniform(0.4, 0.9),
                int(random.integers(3)),
            )
        )
    wall, floor = random.uniform(7.0, 10.0), random.uniform(1.0, 1.5)
    light_from = np.array([random.uniform(-0.6, 0.6), -0.8, -0.7])
    light_from /= np.linalg.norm(light_from)
    objects = Objects(textures, spheres, cards, wall, floor, light_from, gloss)
    cameras, lights, depths = [], [], []
    arc = random.uniform(0.35, 0.9)
    for index in range(views):
        camera = _camera(random, index, arc, width, height, views)
        wide = camera.with_margin(MARGIN)
        light, depth = _cast(wide, objects, finer)
        cameras.append(camera)
        lights.append(light)
        depths.append(depth)
    light_all, depth_all = np.stack(lights), np.stack(depths)
    return Scene(cameras, light_all, depth_all, _points(random, cameras, light_all, depth_all))


def kept_scene(seed: int, folder: Path) -> Scene:
    """`make_scene`, kept in `folder` from run to run."""
    path = folder / f"scene_{seed:02d}.npz"
    if path.is_file():
        with np.load(path) as kept:
            rows = zip(kept["lens"], kept["r"], kept["t"], strict=True)
            cameras = [Camera(f"view_{i:03d}.png", WIDTH, HEIGHT, *f, r, t) for i, (f, r, t) in enumerate(rows)]
            points = SparsePoints(kept["points"], kept["colours"])
            return Scene(cameras, kept["light"].astype(np.float32), kept["depth"].astype(np.float32), points)
    scene = make_scene(seed)
    folder.mkdir(parents=True, exist_ok=True)
    lens = np.array([[c.fx, c.fy, c.cx, c.cy] for c in scene.cameras])
    r, t = np.stack([c.rotation for c in scene.cameras]), np.stack([c.translation for c in scene.cameras])
    np.savez_compressed(
        path,
        lens=lens,
        r=r,
        t=t,
        light=scene.light.astype(np.float16),
        depth=scene.depth,
        points=scene.points.positions,
        colours=scene.points.colours,
    )
    return scene


def _camera(random: np.random.Generator, index: int, arc: float, width: int, height: int, views: int) -> Camera:
    turn = arc * (index / (views - 1) - 0.5) + random.uniform(-0.02, 0.02)
    target, distance = np.array([0.0, 0.0, 5.0]), random.uniform(4.2, 5.8)
    centre = target + distance * np.array([math.sin(turn), random.uniform(-0.16, 0.02), -math.cos(turn)])
    forward = target - centre
    forward /= np.linalg.norm(forward)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    f = 1.05 * width
    return Camera(f"view_{index:03d}.png", width, height, f, f, width / 2, height / 2, rotation, -rotation @ centre)


@dataclass
class Objects:
    """What rays meet: textures that wrap; spheres (middle, radius, texture); square cards (middle, normal, axis across,
    half a side, texture); a wall at this depth and a floor at this height; the direction to the light; gloss."""

    textures: list[np.ndarray]
    spheres: list[tuple]
    cards: list[tuple]
    wall: float
    floor: float
    light_from: np.ndarray
    gloss: float


def _cast(camera: Camera, objects: Objects, finer: int) -> tuple[np.ndarray, np.ndarray]:
    """[H, W, 3] linear light, [H, W] depth."""
    light_from, gloss = objects.light_from, objects.gloss
    u = (np.arange(camera.width * finer) + 0.5) / finer
    v = (np.arange(camera.height * finer) + 0.5) / finer
    x, y = np.meshgrid((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    rays = (np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ camera.rotation).astype(np.float32)
    origin = camera.centre.astype(np.float32)
    nearest = np.full(len(rays), 1e9, np.float32)
    colour = np.zeros((len(rays), 3), np.float32)

    def paint(hit, t, texture, a, b, normal):
        """A surface's texture at coordinates a, b (texels wrap), lit from one side."""
        nearest[hit] = t
        index = (np.floor(a * 200).astype(int) % TEXTURE, np.floor(b * 200).astype(int) % TEXTURE)
        facing = np.clip(normal @ light_from if normal.ndim > 1 else float(normal @ light_from), 0, 1)
        shade = (0.35 + 0.65 * np.asarray(facing))[..., None]
        value = objects.textures[texture][index] * shade
        if gloss:
            half = light_from - rays[hit] / np.linalg.norm(rays[hit], axis=1, keepdims=True)
            half /= np.linalg.norm(half, axis=1, keepdims=True)
            value = value + gloss * np.clip((half * normal).sum(-1), 0, 1)[:, None] ** 24
        colour[hit] = value

    def plane(point, normal, inside, texture, a_axis, b_axis):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((point - origin) @ normal) / (rays @ normal.astype(np.float32))
        hit = np.flatnonzero((t > 0.1) & (t < nearest))
        place = origin + rays[hit] * t[hit, None] - point
        a, b = place @ a_axis, place @ b_axis
        keep = inside(a, b)
        paint(hit[keep], t[hit[keep]], texture, a[keep], b[keep], normal)

    everywhere = lambda a, b: np.ones(len(a), bool)  # noqa: E731
    axes = np.eye(3)
    plane(np.array([0.0, 0.0, objects.wall]), -axes[2], everywhere, 0, 0.6 * axes[0], 0.6 * axes[1])
    plane(np.array([0.0, objects.floor, 0.0]), -axes[1], everywhere, 1, 0.8 * axes[0], 0.8 * axes[2])
    for middle, normal, across, half, texture in objects.cards:
        plane(
            middle,
            normal,
            lambda a, b, h=half: (np.abs(a) < h) & (np.abs(b) < h),
            texture,
            across,
            np.cross(normal, across),
        )
    for middle, radius, texture in objects.spheres:
        to = origin - middle.astype(np.float32)
        aa = (rays**2).sum(1)
        bb = rays @ to
        root = bb**2 - aa * (to @ to - radius**2)
        t = np.where(root > 0, (-bb - np.sqrt(np.maximum(root, 0))) / aa, 1e9).astype(np.float32)
        hit = np.flatnonzero((t > 0.1) & (t < nearest))
        normal = (origin + rays[hit] * t[hit, None] - middle) / radius
        a, b = np.arctan2(normal[:, 0], -normal[:, 2]) * radius, np.arcsin(np.clip(normal[:, 1], -1, 1)) * radius
        paint(hit, t[hit], texture, a, b, normal)
    h, w = camera.height, camera.width
    light = colour.reshape(h, finer, w, finer, 3).mean((1, 3))
    # Along the optical axis, as the rays' z in the camera is 1.
    return light.astype(np.float32), nearest.reshape(h, finer, w, finer)[:, finer // 2, :, finer // 2].copy()


def _points(random, cameras, light, depth) -> SparsePoints:
    positions, colours = [], []
    for index, camera in enumerate(cameras):
        inner = light[index, MARGIN:-MARGIN, MARGIN:-MARGIN].mean(2)
        texture = ndimage.gaussian_gradient_magnitude(inner, 1.5)
        rows, columns = np.nonzero(texture > np.quantile(texture, 0.7))
        chosen = random.choice(len(rows), 160, replace=False)
        r, c = rows[chosen], columns[chosen]
        z = depth[index][r + MARGIN, c + MARGIN].astype(np.float64)
        local = np.stack([(c + 0.5 - camera.cx) / camera.fx * z, (r + 0.5 - camera.cy) / camera.fy * z, z], 1)
        positions.append((local - camera.translation) @ camera.rotation)
        colours.append(linear_to_srgb(np.clip(light[index, r + MARGIN, c + MARGIN].astype(np.float64), 0, 1)) * 255)
    return SparsePoints(np.concatenate(positions), np.concatenate(colours).astype(np.uint8))


def degrade(scene: Scene, truth: Truth, seed: int = 0) -> list[np.ndarray]:
    """The photos, [H, W, 3] uint8, sRGB."""
    random = np.random.default_rng([seed, 5])
    near, far = np.quantile(scene.depth, [0.02, 0.98])
    median = float(np.median(scene.depth))
    height, width, views = scene.cameras[0].height, scene.cameras[0].width, len(scene.cameras)
    gains = _gains(random, truth, views)
    level = np.quantile(scene.light, 1 - truth.saturation) if truth.saturation else 1.0
    own = own_sigmas(truth, views, seed)
    photos = []
    veil = np.array([0.62, 0.68, 0.75])
    for index in range(len(scene.cameras)):
        light, depth = scene.light[index].astype(np.float64), scene.depth[index].astype(np.float64)
        if truth.haze:
            passed = np.exp(-truth.haze / median * depth)[..., None]
            light = light * passed + veil * (1 - passed)
        encoded = truth.space == "srgb"
        light = linear_to_srgb(np.clip(light, 0, None)) if encoded else light
        if truth.defocus:
            light = _defocus(light, depth, near, far, truth.defocus)
        if truth.field:
            light = _blurred(light, truth.field * np.sqrt(_radius2(height, width, MARGIN)))
        for kernel in _kernels(truth, float(own[index]), random):
            light = _convolved(light, kernel)
        light = (srgb_to_linear(light) if encoded else light)[MARGIN:-MARGIN, MARGIN:-MARGIN]
        if truth.vignetting:
            r2 = _radius2(height, width)
            light = light * (1 - truth.vignetting * r2)[..., None]
        light = light * gains[index] / level
        values = linear_to_srgb(np.clip(light, 0, 1))
        values = values + truth.noise / 255 * random.standard_normal(values.shape)
        photos.append(np.round(np.clip(values, 0, 1) * 255).astype(np.uint8))
    return photos


def _kernels(truth: Truth, own: float, random: np.random.Generator) -> list[np.ndarray]:
    """What blurs a whole photo alike, in order: the medium, the photo's own width, its motion."""
    found = [_gaussian(*truth.psf)] if any(truth.psf[:2]) else []
    found += [_gaussian(own, own, 0.0)] if own else []
    if truth.motion:
        found.append(_path(truth.motion * random.uniform(0.6, 1.4), random.uniform(0, 180)))
    return found


def own_sigmas(truth: Truth, views: int, seed: int) -> np.ndarray:
    """[V] px: what `degrade` blurs each photo with of its own."""
    return np.random.default_rng([seed, 9]).uniform(*truth.own, views)


def own_paths(truth: Truth, scene: Scene, seed: int) -> np.ndarray:
    """[V, 2] length (px) and angle (degrees) of the paths that `degrade` draws: the same numbers in the same order."""
    random = np.random.default_rng([seed, 5])
    camera, views = scene.cameras[0], len(scene.cameras)
    random.standard_normal(views)  # the gains
    random.standard_normal((views, 3))
    paths = []
    for _ in range(views):
        paths.append((truth.motion * random.uniform(0.6, 1.4), random.uniform(0, 180)))
        random.standard_normal((camera.height, camera.width, 3))  # the noise
    return np.array(paths)


def write_set(folder: Path, scene: Scene, photos: list[np.ndarray], sharp: list[np.ndarray] | None = None) -> None:
    """photos/ and cameras/ (COLMAP text, with points), and truth/ of what would have been sharp."""
    for part, pictures in (("photos", photos), ("truth", sharp)):
        if pictures is not None:
            (folder / part).mkdir(parents=True, exist_ok=True)
            for camera, pixels in zip(scene.cameras, pictures, strict=True):
                Image.fromarray(pixels).save(folder / part / camera.name)
    write_model(folder / "cameras", {c.name: c for c in scene.cameras}, scene.points, binary=False)


def _gains(random: np.random.Generator, truth: Truth, views: int) -> np.ndarray:
    """[V, 3]; spreads are exactly those asked for."""
    exposure = random.standard_normal(views)
    exposure = (exposure - exposure.mean()) / exposure.std() * truth.exposure
    balance = random.standard_normal((views, 3))
    balance -= balance.mean(axis=1, keepdims=True)
    balance = (balance - balance.mean(axis=0)) / balance.std() * truth.white_balance
    return np.exp(exposure[:, None] + balance - max(0.0, float((exposure[:, None] + balance).max()) * 0.5))


def _radius2(height: int, width: int, margin: int = 0) -> np.ndarray:
    """[H + 2m, W + 2m] squared distance from the photo's middle over half its diagonal."""
    y, x = np.mgrid[-margin : height + margin, -margin : width + margin]
    return ((x - width / 2) ** 2 + (y - height / 2) ** 2) / ((width / 2) ** 2 + (height / 2) ** 2)


def _defocus(light: np.ndarray, depth: np.ndarray, near: float, far: float, strength: float) -> np.ndarray:
    """Gaussian of a width that grows with the distance in 1 / depth from the focal plane."""
    middle, span = (1 / near + 1 / far) / 2, (1 / near - 1 / far) / 2
    return _blurred(light, np.minimum(strength * np.abs(1 / depth - middle) / span, 2 * strength))


def _blurred(light: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Every px with a Gaussian of its own width (px), out of nine levels."""
    levels = np.linspace(0, sigma.max(), 9)
    stack = [light if s == 0 else ndimage.gaussian_filter(light, (s, s, 0)) for s in levels]
    position = np.clip(sigma / max(levels[1], 1e-9), 0, 8 - 1e-6)
    lower = position.astype(int)
    share = (position - lower)[..., None]
    picked = [np.take_along_axis(np.stack(stack), (lower + k)[None, ..., None], 0)[0] for k in (0, 1)]
    return picked[0] * (1 - share) + picked[1] * share


def _gaussian(sx: float, sy: float, angle: float) -> np.ndarray:
    reach = math.ceil(4 * max(sx, sy))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    values = np.exp(-0.5 * (((x * c + y * s) / max(sx, 1e-3)) ** 2 + ((-x * s + y * c) / max(sy, 1e-3)) ** 2))
    return values / values.sum()


def _path(length: float, angle: float) -> np.ndarray:
    """A straight path of the camera while the shutter is open."""
    reach = math.ceil(length / 2) + 2
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    for t in np.linspace(-length / 2, length / 2, 101):
        x, y = reach + t * math.cos(math.radians(angle)), reach + t * math.sin(math.radians(angle))
        i, j = int(y), int(x)
        for di, dj in ((0, 0), (0, 1), (1, 0), (1, 1)):
            kernel[i + di, j + dj] += (1 - abs(y - i - di)) * (1 - abs(x - j - dj))
    return kernel / kernel.sum()


def _convolved(light: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    from scipy.signal import fftconvolve

    reach = kernel.shape[0] // 2
    wide = np.pad(light, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
    return np.stack([fftconvolve(wide[..., c], kernel, "valid") for c in range(3)], -1)
