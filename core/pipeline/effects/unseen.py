"""Exposures of photos that no training has seen: as those of the photos taken before and after them, if that is so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ...imaging.formation.chain import Formation
from ...imaging.formation.exposure import Exposure
from ...numbers import BY_DEFINITION, number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class UnseenSettings:
    """Numbers of the prediction."""

    sure: float = number(
        2.0, "standard errors", "by which neighbours must be alike; else a photo has the mean exposure", BY_DEFINITION
    )
    fewest: int = number(5, "photos", "whose exposures are known, to say whether neighbours are alike", BY_DEFINITION)


SETTINGS = UnseenSettings()


def formation_of_all(formation: Formation, names: Sequence[str]) -> Formation:
    """The chain, with exposures for all photos; the very same one where it has none."""
    if Exposure.name not in formation.names:
        return formation
    return Formation([with_unseen(e, names) if isinstance(e, Exposure) else e for e in formation.effects])


def with_unseen(exposure: Exposure, names: Sequence[str]) -> Exposure:
    """The exposures, and those that are to be expected of all other photos; no px of these is looked at.

    Cameras that set their exposure themselves follow the scene: the photos before and after say what it was. How far
    is asked of the known ones, each predicted from its neighbours: x_i = share p_i, in log gains. Where the share is no
    more than chance (a set without order), unseen photos have the mean exposure, and are not named.

    Args:
        names: of all photos with a camera; by name is the order in which they were taken.
    """
    order = sorted(set(names) | set(exposure.names))
    gains = exposure.parameters["log_gains"].detach().double().cpu().numpy()
    known = dict(zip(exposure.names, gains, strict=True))
    unseen = [name for name in order if name not in known]
    if not unseen or len(known) < SETTINGS.fewest:
        return exposure
    at = np.array([place for place, name in enumerate(order) if name in known])
    rows = np.stack([known[order[place]] for place in at])
    share = _share(rows, at)
    if share <= 0.0:
        return exposure
    expected = share * np.stack([_between(at, rows, order.index(name)) for name in unseen])
    like = exposure.parameters["log_gains"]
    more = torch.from_numpy(expected).to(like)
    offsets = exposure.parameters["offsets"]
    return Exposure(
        [*exposure.names, *unseen], torch.cat([like, more]), torch.cat([offsets, offsets.new_zeros(more.shape)])
    )


def _between(at: NDArray[np.int64], rows: Array, place: int) -> Array:
    """[3] log gains at a place in the order, linearly between the known ones before and after."""
    return np.array([np.interp(place, at, rows[:, c]) for c in range(rows.shape[1])])


def _share(rows: Array, at: NDArray[np.int64]) -> float:
    """In [0, 1]: how much of a photo's common log gain its neighbours' foretell; 0 where that may be chance."""
    common = rows.mean(axis=1)
    others = [np.delete(np.arange(len(at)), i) for i in range(len(at))]
    near = np.array([np.interp(at[i], at[o], common[o]) for i, o in enumerate(others)])
    power = float((near**2).sum())
    if power <= 0.0:
        return 0.0
    share = float((near * common).sum()) / power
    rest = common - share * near
    error = float(np.sqrt((rest**2).sum() / (len(at) - 1) / power))
    return min(share, 1.0) if share > SETTINGS.sure * error else 0.0
