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
from ...pose import Pose
from ...rigid_motion import twist_between
from .along import Along
from .coordinates import backwards, common_to, flow, px_units
from .equations import PathEquations, SeenPx
from .readout import LearnedReadout, slopes_in_readout, step_and_variance
from .rivals import Rival, Shown, curved_rivals, left_of, nearer, straight_rivals
from .settings import SETTINGS, CameraPathSettings
from .slopes import Looked, Sampled
from .tone import LearnedTone


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

        A step sees near ones only: a wrong path holds itself. So others take a few steps each, and what they leave of
        the photo decides.

        Args:
            still: [3, H, W] sRGB as the twin shows the photo from its camera.
            expose: what the twin shows in the photo along the path that it has then; others as of `learn`.
        """
        i, s = self._index[name], self.settings
        visit, own = Visit(i, name, camera, photo, counts), self._twists[i].clone()
        rivals = self._rivals(visit, own, still)
        if not rivals:
            return
        chosen, least = own, self._left(visit, expose())
        for rival in rivals:
            self._twists[i] = rival.path
            for _ in range(s.again_steps):
                exposed = expose()
                if len(exposed.frames) > 1:
                    self._step(visit, exposed)
            left = self._left(visit, expose())
            if nearer(least, left, s.again_part) > rival.surely:
                chosen, least = self._twists[i].clone(), left
        self._twists[i] = chosen
        self._settle(i)

    def _rivals(self, visit: Visit, own: Tensor, still: Tensor) -> list[Rival]:
        """Paths that are compared with a photo's own [M + 1, 6].

        Where all rows are exposed at once, the direction of time makes no difference.
        """
        shown = Shown(visit.camera, visit.photo, visit.counts, still, self.motion.unit)
        if self.motion.readout != 0.0:
            return straight_rivals(shown, own, self.motion.exposures, self.settings)
        likely = self._prior(visit.name).reshape(-1, 6)[:, 0].numpy() * (shown.diagonal / self._diagonal[visit.name])
        return curved_rivals(shown, own, np.r_[np.inf, likely[1:]], self.settings)

    def _left(self, visit: Visit, exposed: Exposed) -> NDArray[np.float64]:
        """[h, w] what a path leaves of a photo."""
        return left_of(visit.photo, exposed.degraded, visit.counts, self.settings.looked_at)

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
        depth = self._depths[visit.name].depth.clamp(min=self.settings.nearest)
        moves = flow(visit.camera, at, depth, self._units[visit.index])
        return SeenPx(along.right, along.down, moves, asked, shown - seen)

    def _counted(self, visit: Visit, at: Sampled) -> Tensor:
        """[3, h, w] 1 for the px of a photo that count."""
        if visit.counts is None:
            return torch.ones_like(at.of_planes(visit.photo), device="cpu")
        return in_memory(at.of_planes(visit.counts)).expand(3, -1, -1).float()

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
