"""Photos that stay on a graphics card between steps: to bring one there takes longer than to render it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..background import Colour
from ..devices import backend_on
from .grid import GridView


@dataclass(frozen=True)
class OnDevice:
    """A photo as a step compares with it: [3, h, w] sRGB float32, and [h, w] px that count (None: all do)."""

    planes: Tensor
    valid: Tensor | None


class KeptPhotos:
    """The photos of one grid on a device. Those asked for first stay there, as many as its back end keeps.

    (Every photo comes once a round, so that throwing out the one not used longest would never find one again.)
    """

    def __init__(self, device: torch.device) -> None:
        self.device, self._backend = device, backend_on(device)
        self._room = self._backend.photo_bytes
        self._kept: dict[str, tuple[GridView, OnDevice]] = {}

    def of(self, view: GridView, colour: Colour) -> OnDevice:
        """The photo with an sRGB colour in [0, 1] behind what is empty in it."""
        kept = self._kept.get(view.name)
        if kept is not None and kept[0].is_photo_of(view):
            return kept[1]
        planes = torch.from_numpy(view.over(colour))
        valid = None if view.valid is None else torch.from_numpy(view.valid)
        size = sum(t.numel() * t.element_size() for t in (planes, valid) if t is not None)
        if not view.opaque or kept is not None or size > self._room:
            return OnDevice(planes.to(self.device), None if valid is None else valid.to(self.device))
        self._room -= size
        found = OnDevice(self._backend.settled(planes), None if valid is None else self._backend.settled(valid))
        self._kept[view.name] = view, found
        return found
