"""The house's rules, proved by reading the code: who may import whom, and what no file may name."""

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from dgs.tests.core.import_graph import FLOORS, ImportGraph, package_of
from dgs.tests.core.reasons import bare_numbers
from dgs.tools import mutants

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("core", "studies", "dgs_addon", "operators", "panels", "command_line", "api")
BLENDER = {"bpy", "bpy_extras", "mathutils", "gpu", "gpu_extras", "bmesh", "blf", "bl_math", "aud", "idprop"}
#: What Blender's own Python must be able to read: numpy is there, torch is not.
WITHOUT_TORCH = (
    "cloud",
    "camera",
    "conventions",
    "errors",
    "files",
    "progress",
    "formats.cameras",
    "formats.gaussians",
    "photos.kinds",
    "measure.boards",
    "measure.rows",
    "change.files",
    "colour",
)

#: Imports inside functions in the whole tree, each with its reason: 306 before this was counted. It may only shrink.
LATE_IMPORTS = 161

NAMES_BLENDER = "import numpy\nfrom mathutils import Vector\n"
NAMES_ITSELF = "from dgs.core.camera import Camera\n"


def sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def imports(source: str) -> Iterator[str]:
    """Full names of all absolute imports, wherever in the file they stand."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module or ""
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if called in ("import_module", "__import__"):
                yield str(node.args[0].value)


def tops(source: str) -> set[str]:
    return {name.split(".")[0] for name in imports(source)}


def tracked() -> list[Path]:
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if listing.returncode:
        pytest.skip("no git clone")
    return [ROOT / name for name in listing.stdout.decode().split("\0") if name and (ROOT / name).is_file()]


def test_the_reader_of_imports_sees_them():
    assert "mathutils" in tops(NAMES_BLENDER)
    assert "dgs" in tops(NAMES_ITSELF)
    assert "bpy" in tops("def f():\n    import importlib\n    importlib.import_module('bpy.types')\n")
    assert "bpy" in tops("if True:\n    import bpy.types as t\n")


def test_the_engine_imports_nothing_of_blender():
    files = sources("core")
    assert len(files) > 30
    wrong = {str(file): sorted(tops(file.read_text("utf-8")) & BLENDER) for file in files}
    assert {file: names for file, names in wrong.items() if names} == {}


@pytest.fixture(scope="module")
def graph() -> ImportGraph:
    return ImportGraph(ROOT, PACKAGES)


def test_every_package_has_a_floor(graph):
    assert graph.without_floor() == set()
    assert len(graph.files) > 200


def test_no_import_leads_to_a_higher_floor(graph):
    """What stands on a floor imports nothing of what is built on it; two packages of a floor do not know each other."""
    assert graph.upward() == []


def test_only_the_command_line_imports_studies(graph):
    users = {
        package_of(m).split(".")[0] for m, others in graph.edges.items() for o in others if o.startswith("studies")
    }
    assert users == {"studies", "command_line"}


def test_studies_of_the_method_take_the_stages_that_a_run_takes(graph):
    """A study that finds cameras or makes views in its own way would measure another program."""
    parts = {"core.sfm.find", "core.photos.undistort", "core.photos.movie", "core.twin.refine_cameras"}
    measured = [m for m in graph.edges if m.startswith(("studies.comparison", "studies.tradeoff", "core.effort"))]
    assert {m: graph.edges[m] & parts for m in measured if graph.edges[m] & parts} == {}
    of_pipeline = {o for m in measured for o in graph.edges[m] if o.startswith("core.pipeline.")}
    assert {f"core.pipeline.{stage}" for stage in ("photos", "medium", "cameras", "simulated", "fitted")} <= of_pipeline


def test_no_modules_import_each_other_in_a_circle(graph):
    assert graph.circles() == []


def test_imports_inside_functions_say_why(graph):
    """At the top of the file, unless they save start-up time or Blender's Python lacks the package."""
    assert [f"{one.module}:{one.line}" for one in graph.inside if not one.has_reason] == []
    assert len(graph.inside) <= LATE_IMPORTS


def test_numbers_at_the_top_of_a_module_say_what_they_are():
    """Tuned numbers are fields of settings (`core.numbers`); a definition has a comment."""
    found = {
        f"{file.relative_to(ROOT)}:{line}": name
        for file in sources("core")
        if file.name != "constants.py" and not file.stem.endswith("kernels")
        for name, line in bare_numbers(file.read_text("utf-8"))
    }
    assert found == {}


def test_the_reader_of_numbers_sees_them():
    assert bare_numbers("A = 1\n") == [("A", 1)]
    assert bare_numbers("#: Why.\nA = 1\nB, C = 2.0, -3\n") == [("B", 3), ("C", 3)]
    assert bare_numbers("A = (1, 2 * 3)  # why\nb = 4\nNAME = 'x'\n") == []


def test_the_reader_of_the_graph_sees_circles_and_reasons(tmp_path):
    (tmp_path / "core" / "sfm").mkdir(parents=True)
    (tmp_path / "core" / "a.py").write_text("def f():\n    from .sfm import b\n    import torch  # heavy: torch\n")
    (tmp_path / "core" / "sfm" / "b.py").write_text("from .. import a\n")
    found = ImportGraph(tmp_path, ("core",))
    assert found.circles() == [["core.a", "core.sfm.b"]]
    assert found.upward() == ["core.a -> core.sfm.b"]
    assert [(one.line, one.has_reason) for one in found.inside] == [(2, False), (3, True)]
    assert len(set(sum(FLOORS, ()))) == len(sum(FLOORS, ()))


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_themselves_relatively(package):
    own = {*PACKAGES, "dgs", "run_dgs"}
    # What is started as a file or by `python -m` has to mount the package itself.
    started = [ROOT / "core/sfm/worker.py", *(ROOT / "studies").glob("*/__main__.py")]
    files = [file for file in sources(package) if file not in started]
    wrong = {str(file): sorted(tops(file.read_text("utf-8")) & own) for file in files}
    assert {file: names for file, names in wrong.items() if names} == {}


def test_the_top_level_is_as_agreed():
    files = (
        "__init__.py",
        "blender_manifest.toml",
        "run_dgs.py",
        "pyproject.toml",
        "Makefile",
        "LICENSE",
        "CHANGELOG.md",
        "README.md",
        ".ci/run",
        "docs/architecture.md",
        "docs/install.md",
    )
    folders = (*PACKAGES, "tests", "docs", "benchmarks")
    assert [name for name in files if not (ROOT / name).is_file()] == []
    assert [name for name in folders if not (ROOT / name).is_dir()] == []
    assert os.access(ROOT / ".ci/run", os.X_OK)


def test_the_root_only_registers():
    tree = ast.parse((ROOT / "__init__.py").read_text("utf-8"))
    assert not [node for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom))]
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert functions == {"register", "unregister"}


def test_importing_the_root_loads_neither_blender_nor_torch():
    code = "import run_dgs as r, sys; r.mount_package(); sys.exit(len({'bpy', 'torch'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_what_blender_reads_loads_no_torch():
    names = ", ".join(f"dgs.core.{name}" for name in WITHOUT_TORCH)
    code = f"import run_dgs, sys; run_dgs.mount_package(); import {names}; sys.exit('torch' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_no_file_names_a_machine_or_a_registry():
    # Written in pieces, so that this file does not name them either.
    machine = re.compile(r"(?<![\w.}$])/(" + "|".join(["wo" + "rk/", "ro" + "ot/", "home/" + r"\w"]) + ")")
    registry = re.compile(
        "|".join(
            [
                r"py" + r"pi\.org",
                r"python" + r"hosted\.",
                r"deb\." + r"debian\.org",
                r"archive\." + r"ubuntu",
                r"download\." + r"pytorch",
            ]
        )
    )
    wrong = []
    for file in tracked():
        try:
            text = file.read_text("utf-8")
        except UnicodeDecodeError:
            continue  # a picture
        found = [*machine.findall(text), *registry.findall(text)]
        wrong += [f"{file.relative_to(ROOT)}: {name}" for name in found]
    assert wrong == []


def test_nothing_unpickles_and_no_shell_strings():
    wrong = []
    for file in (f for package in PACKAGES for f in sources(package)):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = ast.unparse(node.func)
            keywords = {k.arg: ast.unparse(k.value) for k in node.keywords}
            if (
                name in ("eval", "exec", "os.system", "os.popen", "pickle.load", "pickle.loads")
                or keywords.get("shell") == "True"
                or keywords.get("allow_pickle") == "True"
                or (name == "torch.load" and keywords.get("weights_only") != "True")
            ):
                wrong.append(f"{file.relative_to(ROOT)}:{node.lineno}: {name}")
    assert wrong == []


def test_every_mutation_still_applies():
    """Whoever moves a line that `make known-mutants` breaks moves the mutation, too."""
    assert {one.what: why for one in mutants.MUTATIONS if (why := mutants.misfit(one))} == {}
    assert {one.target for one in mutants.MUTATIONS if not (ROOT / one.target).is_file()} == set()


def test_every_pinned_requirement_is_locked_to_the_same_version():
    def pins(name: str) -> dict[str, str]:
        lines = (ROOT / name).read_text("utf-8").splitlines()
        return dict(line.strip().split("==") for line in lines if "==" in line and not line.startswith("#"))

    wanted = pins("requirements.txt") | pins("requirements-dev.txt")
    locked = pins("requirements.lock")
    assert len(wanted) > 10
    assert {name: locked.get(name) for name in wanted} == wanted
