"""What `change` finds between twins of `cracked_wall`, beside what is true.

python -m benchmarks.changed BEFORE AFTER               # the second week, or the same scene photographed again
python -m benchmarks.changed BEFORE AFTER --elsewhere   # the second twin in another world, which is to be found
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from dgs.core.change.alignment import inverse
from dgs.core.change.compared import changes
from dgs.core.change.findings import Changes
from dgs.core.change.motion import rotation_of
from dgs.core.change.surface import Surface
from dgs.core.change.tables import lines
from dgs.core.evaluation.poses import Similarity
from dgs.core.formats.turning import moved
from dgs.core.gaussians import Gaussians
from dgs.core.machine import use_machine
from dgs.core.progress import Silent
from dgs.core.training.scale import twin_scale
from dgs.core.twin.opened import OpenedTwin, open_twin

#: Where the second twin's world may be.
ELSEWHERE = Similarity(37.0, rotation_of(np.array([0.4, -1.0, 2.0])), np.array([50.0, -20.0, 10.0]), 3)


def elsewhere(twin: OpenedTwin, world: Similarity) -> OpenedTwin:
    """The same twin in another world."""
    cloud = moved(twin.gaussians.cloud(), world.rotation, world.scale, world.translation)
    views = [replace(view, camera=world.camera(view.camera)) for view in twin.views]
    scale = twin_scale([view.camera for view in views], cloud.means)
    return replace(twin, views=views, gaussians=Gaussians.from_cloud(cloud), scale=scale)


def parts(found: Changes, first: Surface) -> None:
    """What is called changed of each part of the wall."""
    at, held = first.places.at, found.held
    x, up, out = at[:, 0], -at[:, 1], -at[:, 2]
    called = np.zeros(len(at), bool)
    for region in found.regions:
        called[region.places] |= not region.after
    for name, part in {
        "all": np.ones(len(at), bool),
        "block's front": (abs(x - 0.36) < 0.08) & (abs(up - 0.18) < 0.08) & (out > 0.04),
        "knob": (x - 0.38) ** 2 + (up + 0.22) ** 2 < 0.07**2,
        "middle crack": abs(x + 0.19) < 0.04,
        "wall, far from all": (x < 0.02) & (abs(x + 0.19) > 0.14),
    }.items():
        share = 100 * called[part & held].mean()
        print(f"{name}: {(part & held).sum()} places, in a region {share:.2f} %")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--elsewhere", action="store_true", help="move the second twin into another world first")
    options = parser.parse_args()
    threads = use_machine(None)
    before, later = open_twin(options.before, Silent()), open_twin(options.after, Silent())
    began = time.perf_counter()
    if options.elsewhere:
        later = elsewhere(later, ELSEWHERE)
    found, first, _ = changes(before, later, threads, Silent())
    print("\n".join(lines(found)))
    aligned = found.alignment
    print(f"{time.perf_counter() - began:.0f} s; {aligned.how}, {aligned.matches} matches", end=", ")
    print(f"deviation {aligned.deviation:.3f} px, taken out last {aligned.taken:.3f} px; light {found.gain:.3f}")
    if options.elsewhere:
        off = aligned.similarity.points(ELSEWHERE.points(first.places.at)) - first.places.at
        print(f"the world is off by {np.median(np.linalg.norm(off, axis=1) / first.places.pixel):.3f} px (median)")
        print(f"its scale by {aligned.similarity.scale / inverse(ELSEWHERE).scale - 1:+.2e}")
    parts(found, first)


if __name__ == "__main__":
    main()
