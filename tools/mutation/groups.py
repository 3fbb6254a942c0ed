"""What is mutated, how many mutants are drawn, and which tests stand beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Group:
    """Files that a share is measured for.

    Attributes:
        name: of the group. package: it is counted with.
        patterns: of its files, below core/.
        count: mutants drawn.
        tests: folders or files of the tests beside it.
        left_out: names of files that are not mutated.
    """

    name: str
    package: str
    patterns: tuple[str, ...]
    count: int
    tests: tuple[str, ...]
    left_out: tuple[str, ...] = ()
    kernels: bool = False

    def files(self, tree: Path) -> list[str]:
        """Its files in a tree, relative to it."""
        found = {path for pattern in self.patterns for path in (tree / "core").glob(pattern)}
        names = sorted(path.relative_to(tree).as_posix() for path in found if path.name not in self.left_out)
        return [name for name in names if name.endswith("kernels.py") == self.kernels]


def _package(name: str, plain: int, kernels: int, left_out: tuple[str, ...] = ()) -> list[Group]:
    patterns, tests = (f"{name}/**/*.py",), (f"tests/core/{name}",)
    groups = [Group(name, name, patterns, plain, tests, left_out)]
    if kernels:
        groups.append(Group(f"{name} kernels", name, patterns, kernels, tests, (), kernels=True))
    return groups


_STATE = ("transaction.py", "lock.py", "outputs.py")
_STATE_TESTS = tuple(f"tests/core/test_{name}.py" for name in ("transaction", "lock", "outputs", "files"))
_ALL = (
    *_package("formats", 60, 0),
    *_package("twin", 60, 0),
    *_package("imaging", 54, 6),
    *_package("training", 54, 6),
    *_package("rasterizer", 48, 12),
    *_package("sfm", 54, 6),
    Group("state", "state", _STATE, 60, _STATE_TESTS),
)
#: Kernels last: each is compiled anew.
GROUPS = sorted(_ALL, key=lambda group: group.kernels)
