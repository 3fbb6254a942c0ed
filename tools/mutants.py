"""Proves that tests can fail: breaks a copy of the tree in known ways, and the tests named beside must see each.

    python -m tools.mutants [--only WORD]

Every mutation is applied to a copy of the tracked files in a temporary folder. A mutation that no longer fits the
source, a test that is gone, and a mutant that survives end with status 1.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Mutation:
    """One recorded way to break the engine.

    Attributes:
        family: of hard cases whose tests must see it, or a test file below tests/.
        what: in words.
        file, old, new: `old` occurs exactly once in `file`.
        tests: pytest's -k among those tests.
        also: another (old, new) in the same file, for what only errs in two places.
    """

    family: str
    what: str
    file: str
    old: str
    new: str
    tests: str
    also: tuple[str, str] | None = None

    @property
    def target(self) -> str:
        """The test file."""
        return f"tests/{self.family}" if self.family.endswith(".py") else f"tests/hard_cases/test_{self.family}.py"

    @property
    def changes(self) -> tuple[tuple[str, str], ...]:
        """All (old, new)."""
        return ((self.old, self.new),) + ((self.also,) if self.also else ())


MUTATIONS = (
    Mutation(
        "geometry",
        "the Jacobian's direction is no longer clamped",
        "core/rasterizer/projection.py",
        "tx = (x / z).clamp(-(camera.cx + mx) / camera.fx, (camera.width - camera.cx + mx) / camera.fx)",
        "tx = x / z",
        "clamped",
    ),
    Mutation(
        "geometry",
        "colours without a limit",
        "core/rasterizer/projection.py",
        "    sound &= gaussians.sh[index].square().sum(dim=(1, 2)) <= HARMONICS_LIMIT**2\n",
        "",
        "must and culled and reference",
    ),
    Mutation(
        "rasterizer",
        "backward clamps alpha elsewhere than forward",
        "core/rasterizer/splat_kernels.py",
        'derivative = choose(raw.compare("<", ALPHA_MAXIMUM), derivative, 0.0)',
        'derivative = choose(raw.compare("<", 0.999), derivative, 0.0)',
        "cap and cpu",
    ),
    Mutation(
        "rasterizer",
        "ties in depth are broken by place",
        "core/rasterizer/reference.py",
        "for key in reversed(keys):",
        "for key in keys[:1]:",
        "ties and reference",
    ),
    Mutation(
        "psf",
        "a Gaussian's taps are not normalised",
        "core/imaging/psf.py",
        "return np.asarray(values / values.sum())\n\n\ndef point_spread_from_samples",
        "return np.asarray(values / (sigma * math.sqrt(2 * math.pi)))\n\n\ndef point_spread_from_samples",
        "constant",
    ),
    Mutation(
        "psf",
        "the adjoint is the blur itself",
        "core/imaging/compiled_blurs.py",
        "self.backward = self._taps(kernel, dtype)",
        "self.backward = self.forward",
        "adjoint",
    ),
    Mutation(
        "loss",
        "masked px are compared",
        "core/training/loss/photometric.py",
        "            x = torch.where(self.valid, x, self.photo)\n",
        "            x = x.nan_to_num()\n",
        "masked",
    ),
    Mutation(
        "loss",
        "Adam follows whatever comes",
        "core/training/adam_kernels.py",
        "finite = abs(g[i]) <= f32(1e18)",
        "finite = abs(g[i]) <= f32(1e18) or g[i] != g[i]",
        "Adam",
    ),
    Mutation(
        "poses",
        "cameras are aligned by their centres alone",
        "core/evaluation/poses.py",
        "moment = orientation_weight * sum(",
        "moment = 0.0 * sum(",
        "rail",
    ),
    Mutation(
        "sfm",
        "copies of a photo count as photos",
        "core/views.py",
        "found.setdefault(fingerprint(view.photo), view)",
        "found.setdefault(len(found), view)",
        "copies",
    ),
    Mutation(
        "sfm",
        "a line of native code is taken for a message",
        "core/sfm/find.py",
        "            except ValueError:\n                continue\n",
        "            except KeyError:\n                continue\n",
        "aborts",
    ),
    Mutation(
        "scale",
        "the world is not moved to its origin",
        "core/training/scale.py",
        "SceneScale(np.median(positions, axis=0).astype(np.float64), float(np.median(seen)))",
        "SceneScale(np.zeros(3), float(np.median(seen)))",
        "away and world",
    ),
    Mutation(
        "files",
        "NaN px count",
        "core/photos/load.py",
        "if finite is not None and bool(finite.all()):",
        "if finite is not None and bool(finite.any()):",
        "NaN and infinite",
    ),
    Mutation(
        "core/rasterizer/test_harmonics.py",
        "the fourteenth harmonic has the other sign, in every implementation",
        "core/constants.py",
        "    1.445305721320277,\n",
        "    -1.445305721320277,\n",
        "",
    ),
    Mutation(
        "core/formats/test_small_splat_formats.py",
        ".splat quaternions are x y z w, for reader and writer",
        "core/formats/splat.py",
        'quaternions=((values["rotation"].astype',
        'quaternions=((values["rotation"][:, [3, 0, 1, 2]].astype',
        "splat",
        ("_byte(cloud.quaternions / length", "_byte(cloud.quaternions[:, [1, 2, 3, 0]] / length"),
    ),
    Mutation(
        "core/formats/test_camera_formats.py",
        "p1 and p2 of transforms.json change places",
        "core/formats/transforms.py",
        'Lens("OPENCV", width, height, (*head, k[0], k[1], k[4], k[5]))',
        'Lens("OPENCV", width, height, (*head, k[0], k[1], k[5], k[4]))',
        "distortion",
    ),
    Mutation(
        "core/twin/test_folder.py",
        "a rollback brings no cameras back",
        "core/twin/folder.py",
        "                if (state / part.name).exists():",
        "                if (state / part.name).exists() and not part.folder:",
        "state_comes_back or rollback",
    ),
    Mutation(
        "core/twin/test_folder.py",
        "a rollback leaves files that the state lacked",
        "core/twin/folder.py",
        "                    change.remove(part.name)\n            change.remove(f",
        "                    pass\n            change.remove(f",
        "gone_again",
    ),
    Mutation(
        "core/twin/test_update.py",
        "an update forgets Adam's first moments",
        "core/pipeline/continued.py",
        '            optimizer.first[name] = torch.from_numpy(state.arrays[f"first.{name}"].copy())\n',
        "",
        "moments",
    ),
    Mutation(
        "core/training/test_checkpoints.py",
        "a checkpoint is written in its place",
        "core/training/checkpoint.py",
        "    with replacing(path) as temporary:\n        temporary.write_bytes(archive.getbuffer())\n",
        "    path.write_bytes(archive.getbuffer())\n",
        "whole",
    ),
    Mutation(
        "core/test_files.py",
        "content is not synced before it takes its place",
        "core/files.py",
        "        os.fsync(file.fileno())\n",
        "        pass\n",
        "on_the_disk",
    ),
    Mutation(
        "core/test_files.py",
        "a rename is not synced",
        "core/files.py",
        "        sync_folder(path.parent)\n",
        "",
        "on_the_disk",
    ),
    Mutation(
        "core/test_files.py",
        "a change is decided before its files are synced",
        "core/transaction.py",
        "            _sync_tree(self._next / CONTENT)\n",
        "",
        "on_the_disk",
    ),
    Mutation(
        "core/training/test_training_runs.py",
        "the render ends at the photo's border",
        "core/training/scene.py",
        "return Level(step, views, heldout, margin_for(reach), self._ratio(views, step), contrast)",
        "return Level(step, views, heldout, 0, self._ratio(views, step), contrast)",
        "beyond_the_border",
    ),
    Mutation(
        "core/training/cameras/test_pose_steps.py",
        "the weak prior of a camera's step pushes it away",
        "core/training/cameras/pose_steps.py",
        "np.linalg.inv(matrix + 1.0 / settings.prior**2 * np.eye(6))",
        "np.linalg.inv(matrix - 1.0 / settings.prior**2 * np.eye(6))",
        "mean_of_what",
    ),
    Mutation(
        "core/training/cameras/test_bundle_adjustment.py",
        "cameras and focal length are pushed away from where they were",
        "core/training/cameras/bundle.py",
        "- self.prior * self.drift(state)\n        move",
        "+ self.prior * self.drift(state)\n        move",
        "",
    ),
    Mutation(
        "core/training/cameras/test_bundle_adjustment.py",
        "a prior of cameras and focal length that is a gain, not a cost",
        "core/training/cameras/bundle.py",
        "sum(axis=1)).sum() + (self.prior",
        "sum(axis=1)).sum() - (self.prior",
        "",
    ),
    Mutation(
        "core/training/cameras/test_bundle_adjustment.py",
        "one camera before fixed points is pushed away from where it was",
        "core/training/cameras/bundle.py",
        "- problem.prior[:6] * problem.drift(state)[:6]",
        "+ problem.prior[:6] * problem.drift(state)[:6]",
        "",
    ),
    Mutation(
        "core/training/cameras/test_bundle_adjustment.py",
        "the focal length is not held",
        "core/training/cameras/bundle.py",
        "settings.focal_prior if focal else 1e-9",
        "1e9 if focal else 1e-9",
        "",
    ),
)


def copied(folder: Path) -> Path:
    """A copy of the tracked files."""
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout.decode()
    for name in listing.split("\0"):
        source = ROOT / name
        if name and source.is_file() and not name.startswith("docs/"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, folder / name)
    return folder


def tested(folder: Path, mutation: Mutation) -> int:
    """pytest's exit status for a mutation's tests in a copy of the tree."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        mutation.target,
        "-x",
        *(["-k", mutation.tests] if mutation.tests else []),
    ]
    environment = {**os.environ, "OMP_WAIT_POLICY": "passive", "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(command, cwd=folder, capture_output=True, env=environment, check=False).returncode


def misfit(mutation: Mutation, folder: Path = ROOT) -> str:
    """Why a mutation cannot be applied to a tree; empty if it can."""
    path = folder / mutation.file
    if not path.is_file():
        return f"there is no {mutation.file}"
    source = path.read_text("utf-8")
    wrong = [count for old, _ in mutation.changes if (count := source.count(old)) != 1]
    return f"{mutation.file} holds the text {wrong[0]} times" if wrong else ""


def judged(mutation: Mutation, folder: Path) -> str:
    """'caught', or what is wrong."""
    path = folder / mutation.file
    wrong = misfit(mutation, folder)
    if wrong:
        return f"DOES NOT APPLY: {wrong}"
    source = path.read_text("utf-8")
    if tested(folder, mutation) != 0:
        return "NO TEST: unbroken, the tests do not pass"
    broken = source
    for old, new in mutation.changes:
        broken = broken.replace(old, new)
    path.write_text(broken, "utf-8")
    try:
        status = tested(folder, mutation)
    finally:
        path.write_text(source, "utf-8")
    return {0: "SURVIVED", 1: "caught"}.get(status, f"BROKEN: pytest ended with {status}")


def main() -> int:
    """Runs all mutations; 1 if one is not caught."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", metavar="WORD", help="mutations whose family or words hold this")
    options = parser.parse_args()
    chosen = [m for m in MUTATIONS if options.only.lower() in f"{m.family} {m.what}".lower()]
    verdicts = []
    with tempfile.TemporaryDirectory(prefix="dgs-mutants-") as name:
        folder = copied(Path(name))
        print(f"{'tests':<42}{'mutation':<70}{'verdict'}")
        for mutation in chosen:
            began = time.perf_counter()
            verdicts.append(judged(mutation, folder))
            print(
                f"{mutation.family:<42}{mutation.what:<70}{verdicts[-1]} ({time.perf_counter() - began:.0f} s)",
                flush=True,
            )
    missed = sum(verdict != "caught" for verdict in verdicts)
    print(f"{len(verdicts) - missed} of {len(verdicts)} mutants caught")
    return 1 if missed or not verdicts else 0


if __name__ == "__main__":
    sys.exit(main())
