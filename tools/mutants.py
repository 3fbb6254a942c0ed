"""Proves that the tests of hard cases can fail: breaks a copy of the tree in known ways, and the tests must see each.

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
        family: whose tests must see it.
        what: in words.
        file, old, new: `old` occurs exactly once in `file`.
        tests: pytest's -k among the family's tests.
    """

    family: str
    what: str
    file: str
    old: str
    new: str
    tests: str


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
        "core/training/photometric.py",
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
        "return len({fingerprint(view.photo) for view in views})",
        "return len(views)",
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
)


def copied(folder: Path) -> Path:
    """A copy of the tracked files."""
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout.decode()
    for name in listing.split("\0"):
        source = ROOT / name
        if name and source.is_file() and not name.startswith(("docs/", "benchmarks/")):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, folder / name)
    return folder


def tested(folder: Path, family: str, tests: str) -> int:
    """pytest's exit status for a family's tests in a copy of the tree."""
    command = [sys.executable, "-m", "pytest", f"tests/hard_cases/test_{family}.py", "-x", "-k", tests]
    environment = {**os.environ, "OMP_WAIT_POLICY": "passive", "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(command, cwd=folder, capture_output=True, env=environment, check=False).returncode


def misfit(mutation: Mutation, folder: Path = ROOT) -> str:
    """Why a mutation cannot be applied to a tree; empty if it can."""
    path = folder / mutation.file
    if not path.is_file():
        return f"there is no {mutation.file}"
    count = path.read_text("utf-8").count(mutation.old)
    return "" if count == 1 else f"{mutation.file} holds the text {count} times"


def judged(mutation: Mutation, folder: Path) -> str:
    """'caught', or what is wrong."""
    path = folder / mutation.file
    wrong = misfit(mutation, folder)
    if wrong:
        return f"DOES NOT APPLY: {wrong}"
    source = path.read_text("utf-8")
    if tested(folder, mutation.family, mutation.tests) != 0:
        return "NO TEST: unbroken, the tests do not pass"
    path.write_text(source.replace(mutation.old, mutation.new), "utf-8")
    try:
        status = tested(folder, mutation.family, mutation.tests)
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
        print(f"{'family':<11}{'mutation':<52}{'verdict'}")
        for mutation in chosen:
            began = time.perf_counter()
            verdicts.append(judged(mutation, folder))
            print(
                f"{mutation.family:<11}{mutation.what:<52}{verdicts[-1]} ({time.perf_counter() - began:.0f} s)",
                flush=True,
            )
    missed = sum(verdict != "caught" for verdict in verdicts)
    print(f"{len(verdicts) - missed} of {len(verdicts)} mutants caught")
    return 1 if missed or not verdicts else 0


if __name__ == "__main__":
    sys.exit(main())
