"""The camera's path in each exposure, learned with the Gaussians.

Every time a photo is visited, its path takes a part of a Gauss-Newton step towards what the photo shows, the twin as it
is. No view is rendered for it: a small motion of the camera moves what a px sees by the flow of its depth, so that the
derivative of the photo y(c) by a path's coefficient c_ma (`CameraMotion`; a: axis) is

    dy / dc_ma = - sum over frames k of w_k P_m(2 t_k) (grad I_k . flow_a),

with the frames I_k that the photo is the mean of; where the shutter rolls, w_k differs from row to row. Everything is
in px of the photo at the scene's distance, which makes one prior fit turns and translations. At no motion the photo
has no slope in the path: paths begin away from it.

What photos cannot say is settled by convention: a path may be run in either direction, and what all offsets have in
common, or what follows the cameras' places, is a motion or a bend of the whole scene: it is taken out (`common_to`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...camera import Camera
from ...devices import all_in_memory, in_memory
from ...forward import Exposed
from ...imaging.formation.motion import CameraMotion
from ...imaging.formation.path_poses import mean_twist, middles, polynomials
from ...numbers import BY_DEFINITION, number
from ...pose import Pose
from ...rigid_motion import twist_between
from .along import Along
from .equations import PathEquations, SeenPx
from .readout import LearnedReadout, slopes_in_readout, step_and_variance
from .slopes import Looked, Sampled
from .straight_ways import left_by_ways
from .tone import LearnedTone

#: What some of the numbers below were chosen on, by single runs; docs/real_blur.md has the figures.
_SHAKEN = "27 photos of the rendered ball, shaken by 4 to 16 px (Cycles), one seed"
#: What the others were chosen on.
_FIRST = "a first choice; no other value was compared"


@dataclass(frozen=True)
class CameraPathSettings:
    """Numbers of the learned paths."""

    order: int = number(
        4,
        "degree",
        "of a path in each of its six axes; the prior decides how much a photo needs",
        f"{_SHAKEN}: 2 and 4",
    )
    start: float = number(2.0, "px of the grid", "length of a path at the start at least, in any direction", _FIRST)
    prior_path: float = number(
        0.016,
        "of the photo's diagonal",
        "standard deviation of half of a path's straight way: 8 px of 400 x 300",
        _FIRST,
    )
    prior_fall: float = number(2.0, "power", "of a bend's degree, by which its prior is narrower", _FIRST)
    prior_offset: float = number(1.0, "px", "standard deviation of where a path lies: how far cameras are off", _FIRST)
    photos_per_bend: int = number(
        4,
        "photos",
        "for each number of what offsets may follow the camera's place by: shakes do not, a scene that bends does",
        _FIRST,
    )
    part: float = number(0.4, "share of a step", "that is taken at each visit: the twin changes, too", _FIRST)
    longest_step: float = number(
        1.5, "px", "that a coefficient changes at a visit: the flow is that of small motions", _FIRST
    )
    looked_at: int = number(12_000, "px", "of a photo that a step looks at, evenly over it", _FIRST)
    independent: float = number(400.0, "px", "that a photo's px count as: neighbours err alike", _FIRST)
    huber: float = number(
        1.345,
        "standard deviations",
        "residuals beyond count as their size (95 % efficient on normal noise)",
        BY_DEFINITION,
    )
    depth_every: int = number(4, "visits", "of a photo, after which its depth is drawn anew", _FIRST)
    again_at: tuple[int, ...] = number(
        (5, 12),
        "visits",
        "of a photo, after which straight paths are compared with its own: a wrong direction holds itself",
        f"{_SHAKEN}: two photos keep a path that is wrong by 3 px without; when, is a first choice",
    )
    again_starts: int = number(2, "count", "straight paths that are compared with a photo's own at a time", _FIRST)
    again_steps: int = number(3, "steps", "that each of them takes before it is compared", _FIRST)
    again_turns: int = number(16, "count", "directions that are compared", _FIRST)
    again_factor: float = number(1.3, "ratio", "of one length that is compared to the next shorter one", _FIRST)
    clearly_nearer: float = number(
        0.99,
        "factor",
        "on the mean difference, that another path must leave less of to take the place of a photo's own",
        f"one photo of {_SHAKEN}: after five visits the right path left 0.972 of a wrong one's, as the twin is soft",
    )
    nearest: float = number(
        0.05, "viewing distances", "no depth is less: flow grows without bound towards the camera", _FIRST
    )
    longest: float = number(
        0.25, "of the photo's diagonal", "that any coefficient may be: beyond, a photo is lost", _FIRST
    )
    coarse_share: float = number(
        0.5,
        "share of the run",
        "on the grid of half the resolution at least: paths are found there in a quarter of the time",
        f"{_SHAKEN}: 0.5 26.42 dB, 0.3 26.12",
    )
    unseen_visits: int = number(
        8, "visits", "of a photo that is held out, to find its own path on the finished twin", _FIRST
    )


SETTINGS = CameraPathSettings()


def px_units(camera: Camera) -> NDArray[np.float64]:
    """[6] twist that moves the picture by about a px: translations at distance 1, then turns."""
    px = 1.0 / camera.fx
    corner = 4.0 / math.hypot(camera.width, camera.height)
    return np.array([px, px, corner, px, px, corner])


@dataclass(frozen=True)
class SampledDepth:
    """Depth of a photo where a step looks at it.

    Attributes:
        visits: after which it was drawn; size: (height, width) of the grid; depth: [h, w], the scene's unit.
    """

    visits: int
    size: tuple[int, int]
    depth: Tensor


@dataclass(frozen=True)
class Visit:
    """A photo as a step sees it: its place and name, camera and planes [3, H, W] on the grid, px [H, W] that count."""

    index: int
    name: str
    camera: Camera
    photo: Tensor
    counts: Tensor | None


def common_to(cameras: Sequence[Camera], fewest: int) -> Tensor:
    """[F, F] that leaves of values of F photos what all share, or what follows the place of the camera.

    Args:
        fewest: photos for each of up to four numbers that are common; with fewer, the mean is.
    """
    columns = np.ones((len(cameras), 1))
    if len(cameras) >= fewest * 4:
        places = np.stack([camera.centre for camera in cameras])
        columns = np.concatenate([columns, places - places.mean(axis=0)], axis=1)
    return torch.from_numpy(columns @ np.linalg.pinv(columns, rcond=1e-3)).float()


def backwards(twists: Tensor) -> Tensor:
    """Paths [..., M + 1, 6] run the other way."""
    return twists * torch.tensor([(-1.0) ** m for m in range(twists.shape[-2])])[:, None]


def _stay() -> None:
    """The step of a photo that says nothing."""


class CameraPaths:
    """Paths of photos, fitted and held-out ones.

    Args:
        start: paths to begin with; photos that they do not name stood still, and stay so.
        cameras: of the photos, by name, on the photos' own grid, in units in which the scene is at distance 1.
        fitted: names of those that are trained on: their mean offset is 0.
        step: photo px per px of the coarsest grid.
        alone: whether light meets no other effect on its way to the sensor, so that the camera's curve is asked for.

    Attributes:
        motion: the paths as they are; the forward model's own, so that it sees every step.
        readout: what is found of a rolling shutter; None where its readout was given.
        tone: what is found of the camera's own curve; None where it is not asked for.
    """

    def __init__(
        self,
        start: CameraMotion,
        cameras: Mapping[str, Camera],
        fitted: Sequence[str],
        step: int,
        seed: int,
        settings: CameraPathSettings = SETTINGS,
        alone: bool = True,
    ) -> None:
        self.settings, names = settings, [name for name in start.names if name in cameras]
        self._units = torch.from_numpy(np.stack([px_units(cameras[name]) for name in names])).float()
        self._diagonal = {name: math.hypot(cameras[name].width, cameras[name].height) for name in names}
        twists = torch.zeros(len(names), settings.order + 1, 6)
        known = min(start.order, settings.order) + 1
        twists[:, :known] = start.for_photos(names).parameters["twists"][:, :known]
        self.motion = CameraMotion(names, twists, readout=start.readout, readout_given=start.readout_given)
        self.motion.curve = start.curve
        self._index = {name: i for i, name in enumerate(names)}
        self._fitted = [self._index[name] for name in fitted if name in self._index]
        self.readout = None if start.readout_given else LearnedReadout(len(self._fitted))
        self.tone = LearnedTone(len(self._fitted), start.curve) if alone else None
        self._common = common_to([cameras[names[i]] for i in self._fitted], settings.photos_per_bend)
        self._placed = torch.zeros(len(names), 6)
        self._visits = np.zeros(len(names), np.int64)
        self._depths: dict[str, SampledDepth] = {}
        self._begin(cameras, settings.start * step * self.motion.exposures, seed)

    def _begin(self, cameras: Mapping[str, Camera], px: float, seed: int) -> None:
        """Short paths get a length to begin with: their own direction, or any."""
        turns = np.random.default_rng([seed, 4]).uniform(0.0, 2 * np.pi, len(self.motion.names))
        for i, name in enumerate(self.motion.names):
            length = self.motion.length(name, cameras[name].fx)
            if length >= px:
                continue
            way = self.motion.way(name, cameras[name].fx)
            assert way is not None
            straight = (way[-1] - way[0]) / 2 if length > 0 else torch.tensor([math.cos(turns[i]), math.sin(turns[i])])
            straight = straight * (px / 2 / float(straight.norm().clamp(min=1e-9)) / cameras[name].fx)
            self._twists[i, 1] = 0.0
            self._twists[i, 1, 4], self._twists[i, 1, 3] = straight[0], -straight[1]

    @property
    def _twists(self) -> Tensor:
        return self.motion.parameters["twists"]

    def wants_depth(self, name: str, camera: Camera) -> bool:
        """Whether a photo's depth has to be drawn before its next step, on the grid of `camera`."""
        i = self._index.get(name)
        if i is None or self.motion.frames(name, camera) < 2:
            return False
        known = self._depths.get(name)
        if known is None or known.size != (camera.height, camera.width):
            return True
        return bool(self._visits[i] - known.visits >= self.settings.depth_every)

    def see_depth(self, name: str, depth: Tensor) -> None:
        """Keeps a photo's depth [H, W] where a step looks at it."""
        height, width = depth.shape
        at = Sampled.of(height, width, self.settings.looked_at)
        visits = int(self._visits[self._index[name]])
        self._depths[name] = SampledDepth(visits, (height, width), at.of_planes(depth).cpu().clone())

    def learn(self, name: str, camera: Camera, exposed: Exposed, photo: Tensor, counts: Tensor | None = None) -> None:
        """Takes a part of a step of one photo's path.

        Args:
            camera: of the photo on the grid.
            exposed: what the twin shows in it; photo: [3, H, W] sRGB; counts: [H, W] bool px that count, None for all.
        """
        self.ask(name, camera, exposed, photo, counts)()

    def ask(
        self, name: str, camera: Camera, exposed: Exposed, photo: Tensor, counts: Tensor | None = None
    ) -> Callable[[], None]:
        """What `learn` asks a photo, and what then takes the step: until that is called, no path and no curve moves.

        The asking changes nothing that the forward model reads, so that a backward pass may run beside it.
        """
        i = self._index.get(name)
        if i is None:
            return _stay
        self._visits[i] += 1
        if len(exposed.frames) < 2 or name not in self._depths:
            self._see_nothing(i)
            return _stay
        visit = Visit(i, name, camera, photo, counts)
        looked = self._looked(visit, exposed)
        path = self._equations(visit, looked, *self._shared(i))
        self._see_shared(i, path)

        def take() -> None:
            self._move(visit, path)
            self._settle(visit.index)
            self._move_readout()
            self._move_tone()

        return take

    def _looked(self, visit: Visit, exposed: Exposed) -> Looked:
        """A photo along its path in the px that a step looks at."""
        height, width = visit.photo.shape[1:]
        return Looked(exposed, Sampled.of(height, width, self.settings.looked_at))

    def _see_nothing(self, index: int) -> None:
        """A fitted photo that stood still says nothing of what all share."""
        for shared in (self.readout, self.tone):
            if shared is not None and index in self._fitted:
                shared.see_nothing(self._fitted.index(index))

    def _shared(self, index: int) -> tuple[bool, bool]:
        """Whether a photo is asked what it says of a rolling shutter, and of the camera's curve."""
        fitted = index in self._fitted
        return fitted and self.readout is not None, fitted and self.tone is not None

    def _see_shared(self, index: int, path: PathEquations) -> None:
        """Keeps what a photo says of a rolling shutter (rows and columns), and of the camera's curve."""
        readout, tone = self._shared(index)
        if readout:
            assert self.readout is not None
            rows, columns = (step_and_variance(path, slice(k, k + 1)) for k in (0, 1))
            self.readout.see(self._fitted.index(index), (*rows, *columns))
        if tone:
            assert self.tone is not None
            self.tone.see(self._fitted.index(index), *path.step_of(slice(-2, None)))

    def _move_tone(self) -> None:
        """Takes the curve's next step where all photos have said something of it since the last one."""
        if self.tone is not None and self.tone.due:
            self.tone.move()
            self._show_tone()

    def _show_tone(self) -> None:
        """Lets the forward model file light by the curve as it is."""
        if self.tone is not None:
            self.motion.curve, self.motion.curve_error = self.tone.curve, self.tone.error

    def _move_readout(self) -> None:
        """Takes the shutter's next step where all photos have said something of it since the last one."""
        if self.readout is None or not self.readout.due:
            return
        readout, turned = self.readout.moved(self.motion.readout)
        if turned.any():
            photos = [i for i, back in zip(self._fitted, turned, strict=True) if back]
            self._twists[photos] = backwards(self._twists[photos])
        self.motion.roll(readout)
        self.motion.readout_error = self.readout.error

    def _step(self, visit: Visit, exposed: Exposed) -> None:
        self._move(visit, self._equations(visit, self._looked(visit, exposed)))

    def _equations(self, visit: Visit, looked: Looked, readout: bool = False, tone: bool = False) -> PathEquations:
        """What a step of a photo's path solves, and what the photo says of a rolling shutter and the camera's curve."""
        s = self.settings
        seen, weight = self._seen(visit, looked, readout, tone), self._counted(visit, looked.at)
        size = seen.rest.abs()
        limit = max(s.huber * 1.4826 * float(size.median()), 1e-3)
        weight = weight * (limit / size.clamp(min=1e-12)).clamp(max=1.0)
        sums = seen.sums(weight)
        noise = float(sums[-1, -1]) / max(float(weight.sum()), 1.0)
        sums *= s.independent / max(float(weight.numel()), 1.0) / max(noise, 1e-8)
        precision = self._prior(visit.name) ** -2.0
        beside = self._now(visit)
        beside[:6] -= (self._placed[visit.index] / self._units[visit.index]).double()
        path, asked = slice(len(precision)), slice(len(precision), -1)
        return PathEquations(
            sums[path, path] + torch.diag(precision),
            sums[path, -1] - beside * precision,
            sums[asked, path],
            sums[asked, asked],
            sums[asked, -1],
        )

    def stands(self, camera: Camera) -> Camera:
        """The camera of a photo where it was on average."""
        pose = self.motion.mean_pose(camera.name, Pose(camera.rotation, camera.translation), camera.fx)
        return camera.moved(pose.rotation, pose.translation)

    def place(self, camera: Camera, where: Camera) -> None:
        """Lets a photo's path lie elsewhere from now on: its camera `camera` was at `where` on average.

        What offsets have in common, and what is likely of them, is counted from there.
        """
        i = self._index[camera.name]
        before, after = (np.column_stack([c.rotation, c.translation]) for c in (camera, where))
        beside = mean_twist(self._twists[i], self.motion.frames(camera.name, camera)) - self._twists[i, 0].double()
        self._placed[i] = (torch.from_numpy(twist_between(before, after)) - beside).float()
        self._twists[i, 0] = self._placed[i]

    def _now(self, visit: Visit) -> Tensor:
        """[(M + 1) 6] float64 coefficients of a photo's path, px."""
        return (self._twists[visit.index] / self._units[visit.index]).reshape(-1).double()

    def _move(self, visit: Visit, path: PathEquations) -> None:
        """Takes a part of the step."""
        i, s, now = visit.index, self.settings, self._now(visit)
        move = torch.linalg.solve(path.matrix, path.vector).float() * s.part
        if not bool(torch.isfinite(move).all()):
            return
        move = move * min(1.0, s.longest_step / max(float(move.abs().max()), 1e-9))
        bound = s.longest * self._diagonal[visit.name]
        self._twists[i] = (now.float() + move).clamp(-bound, bound).reshape(-1, 6) * self._units[i]

    def looks_again(self, name: str) -> bool:
        """Whether a photo's path is to be compared with others (`look_again`)."""
        i = self._index.get(name)
        return i is not None and int(self._visits[i]) in self.settings.again_at

    def look_again(
        self,
        name: str,
        camera: Camera,
        photo: Tensor,
        still: Tensor,
        expose: Callable[[], Exposed],
        counts: Tensor | None = None,
    ) -> None:
        """Begins anew with another path where one explains a photo clearly better than its own does.

        A step sees near ones only: a wrong direction holds itself. So straight paths of other directions take a few
        steps each, as the photo's own does, and what they leave of the photo decides.

        Args:
            still: [3, H, W] sRGB as the twin shows the photo from its camera.
            expose: what the twin shows in the photo along the path that it has then; others as of `learn`.
        """
        i, s = self._index[name], self.settings
        visit, own = Visit(i, name, camera, photo, counts), self._twists[i].clone()
        best, chosen = math.inf, own
        for k, start in enumerate([own, *self._others(own, self._straight(visit, still))]):
            self._twists[i] = start
            for _ in range(s.again_steps):
                exposed = expose()
                if len(exposed.frames) > 1:
                    self._step(visit, exposed)
            left = self._left(visit, expose()) * (1.0 if k else s.clearly_nearer)
            if left < best:
                best, chosen = left, self._twists[i].clone()
        self._twists[i] = chosen
        self._settle(i)

    def _others(self, own: Tensor, straight: list[Tensor]) -> list[Tensor]:
        """Paths [M + 1, 6] that are compared with a photo's own: straight ones, and all the other way round.

        Where all rows are exposed at once, the direction of time makes no difference.
        """
        if self.motion.readout == 0.0:
            return straight
        return [backwards(own), *straight, *(backwards(start) for start in straight)]

    def _left(self, visit: Visit, exposed: Exposed) -> float:
        """Mean size of what a path leaves of a photo where it counts."""
        height, width = visit.photo.shape[1:]
        at = Sampled.of(height, width, self.settings.looked_at)
        photo, seen = all_in_memory(at.of_planes(visit.photo), at.of_planes(exposed.degraded))
        rest = (photo - seen).abs().mean(dim=0)
        if visit.counts is None:
            return float(rest.mean())
        counted = rest[in_memory(at.of_planes(visit.counts))]
        return float(counted.mean()) if len(counted) else 0.0

    def _straight(self, visit: Visit, still: Tensor) -> list[Tensor]:
        """Straight paths [M + 1, 6] of different directions, those that explain a photo best."""
        s, photo, camera = self.settings, visit.photo.cpu(), visit.camera
        height, width = photo.shape[1:]
        count = int(math.log(s.longest * math.hypot(height, width)) / math.log(s.again_factor))
        angles, lengths = np.pi * np.arange(s.again_turns) / s.again_turns, s.again_factor ** np.arange(count)
        rests = left_by_ways(still.cpu(), photo, angles, lengths)
        found = [
            (float(rests[turn].min()), length * math.cos(angle), length * math.sin(angle))
            for turn, (angle, length) in enumerate(zip(angles, lengths[rests.argmin(axis=1)], strict=True))
        ]
        beside = [(found[turn - 1][0], found[(turn + 1) % len(found)][0]) for turn in range(len(found))]
        lowest = sorted(f for f, (left, right) in zip(found, beside, strict=True) if f[0] <= left and f[0] <= right)
        starts = []
        for _, x, y in lowest[: s.again_starts]:
            start = torch.zeros_like(self._twists[visit.index])
            start[0] = self._twists[visit.index, 0]
            start[1, 4], start[1, 3] = x / camera.fx / 2, -y / camera.fx / 2
            start[1] *= self.motion.exposures
            starts.append(start)
        return starts

    def _settle(self, index: int) -> None:
        """Takes from the offsets of the fitted photos, in px, what is common to them."""
        if index in self._fitted:
            offsets = (self._twists[self._fitted, 0] - self._placed[self._fitted]) / self._units[self._fitted]
            self._twists[self._fitted, 0] -= (self._common @ offsets) * self._units[self._fitted]

    def _prior(self, name: str) -> Tensor:
        """[(M + 1) 6] standard deviations, px."""
        s = self.settings
        way = s.prior_path * self._diagonal[name] * self.motion.exposures
        each = [s.prior_offset, *(way / m**s.prior_fall for m in range(1, s.order + 1))]
        return torch.tensor(each, dtype=torch.float64).repeat_interleave(6)

    def _seen(self, visit: Visit, looked: Looked, readout: bool = False, tone: bool = False) -> SeenPx:
        """How a photo's px change with its path, and with what else is asked; what is left of them (sRGB)."""
        exposed, at, (height, width) = looked.exposed, looked.at, visit.photo.shape[1:]
        count = len(exposed.frames)
        basis = polynomials(middles(count), self.settings.order).T / count  # [M + 1, T]
        rows = self.motion.row_weights(count, height, width, exposed.shot.margin)
        if rows is not None:
            basis = basis[..., None, None] * (count * rows)  # [M + 1, T, H + 2m, 1] or [M + 1, T, 1, W + 2m]
        along = Along.of(looked, basis, tone)
        seen, shown = all_in_memory(at.of_planes(exposed.degraded), at.of_planes(visit.photo))
        beside = [slopes_in_readout(looked, self.motion.readout)] if readout else []
        beside += [] if along.by_curve is None else [along.by_curve]
        asked = torch.cat(beside) if beside else torch.empty((0, *seen.shape))
        flow = self._flow(visit.index, visit.name, visit.camera, at)
        return SeenPx(along.right, along.down, flow, asked, shown - seen)

    def _counted(self, visit: Visit, at: Sampled) -> Tensor:
        """[3, h, w] 1 for the px of a photo that count."""
        if visit.counts is None:
            return torch.ones_like(at.of_planes(visit.photo), device="cpu")
        return in_memory(at.of_planes(visit.counts)).expand(3, -1, -1).float()

    def _flow(self, index: int, name: str, camera: Camera, at: Sampled) -> Tensor:
        """[2, 6, h, w] px of the grid, along x and along y, by which a px of motion in each axis moves what is seen."""
        rows, columns = torch.arange(camera.height)[at.rows], torch.arange(camera.width)[at.columns]
        y, x = torch.meshgrid(
            (rows + 0.5 - camera.cy) / camera.fy, (columns + 0.5 - camera.cx) / camera.fx, indexing="ij"
        )
        near, zero, f = 1.0 / self._depths[name].depth.clamp(min=self.settings.nearest), torch.zeros_like(x), camera.fx
        du = torch.stack([near, zero, -near * x, -x * y, 1 + x * x, -y])
        dv = torch.stack([zero, near, -near * y, -(1 + y * y), x * y, x])
        units = f * self._units[index][:, None, None]
        return torch.stack([du * units, dv * units]).float()

    def state(self) -> dict[str, NDArray[Any]]:
        """What a checkpoint keeps."""
        drawn = {f"paths.depth.{self._index[name]}": known.depth.numpy() for name, known in self._depths.items()}
        when = np.full((len(self._visits), 3), -1, np.int64)
        for name, known in self._depths.items():
            when[self._index[name]] = known.visits, *known.size
        rolls = {} if self.readout is None else self.readout.state()
        counts = {"paths.visits": self._visits.copy(), "paths.readout": np.array([self.motion.readout])}
        placed = {"paths.placed": self._placed.numpy().copy()}
        curve = {} if self.tone is None else self.tone.state()
        return {"paths": self._twists.numpy().copy(), "paths.drawn": when, **placed, **counts, **drawn, **rolls} | curve

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> bool:
        """Goes on from `state`; whether it is there, and of these photos."""
        twists, visits, drawn = (arrays.get(name) for name in ("paths", "paths.visits", "paths.drawn"))
        if twists is None or visits is None or drawn is None or twists.shape != tuple(self._twists.shape):
            return False
        if not np.isfinite(twists).all() or visits.shape != self._visits.shape or drawn.shape != (len(visits), 3):
            return False
        readout = arrays.get("paths.readout")
        if readout is None or readout.shape != (1,) or (self.readout is not None and not self.readout.restore(arrays)):
            return False
        self.motion.readout = float(readout[0])
        self.motion.readout_error = None if self.readout is None else self.readout.error
        if self.tone is not None and not self.tone.restore(arrays):
            return False
        self._show_tone()
        self._twists.copy_(torch.from_numpy(np.asarray(twists, np.float32)))
        placed = arrays.get("paths.placed")  # (older checkpoints have none)
        if placed is not None:
            if placed.shape != tuple(self._placed.shape) or not np.isfinite(placed).all():
                return False
            self._placed.copy_(torch.from_numpy(np.asarray(placed, np.float32)))
        self._visits = np.asarray(visits, np.int64).copy()
        self._depths.clear()
        for name, i in self._index.items():
            depth = arrays.get(f"paths.depth.{i}")
            when, height, width = (int(value) for value in drawn[i])
            if depth is not None and min(height, width) > 0:
                at = Sampled.of(height, width, self.settings.looked_at)
                if depth.shape != (len(range(*at.rows.indices(height))), len(range(*at.columns.indices(width)))):
                    return False
                found = torch.from_numpy(np.array(depth, np.float32))
                self._depths[name] = SampledDepth(when, (height, width), found)
        return True
