"""Arguments: durations, ranges, one-line errors, and a help that answers at once."""

import subprocess
import sys
import time
from pathlib import Path

import dgs
import pytest
from dgs.command_line import run
from dgs.command_line.arguments import duration
from dgs.command_line.main import build_parser

ROOT = Path(dgs.__file__).parent


@pytest.mark.parametrize(("text", "seconds"), [("120s", 120), ("90", 90), ("2m", 120), ("1.5h", 5400), ("3min", 180)])
def test_durations(text, seconds):
    assert duration(text) == seconds


@pytest.mark.parametrize(
    "arguments",
    [
        ["reconstruct"],
        ["reconstruct", "photos"],
        ["reconstruct", "photos", "--out", "o", "--time-limit", "soon"],
        ["reconstruct", "photos", "--out", "o", "--time-limit", "0"],
        ["reconstruct", "photos", "--out", "o", "--sh-degree", "4"],
        ["reconstruct", "photos", "--out", "o", "--holdout-every", "-1"],
        ["reconstruct", "photos", "--out", "o", "--threads", "many"],
        ["render", "twin.ply", "--out", "o"],
        ["reconstruckt"],
    ],
)
def test_a_wrong_argument_is_one_line(arguments, capsys):
    assert run(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "--help" in error


def test_all_arguments_of_a_reconstruction():
    words = (
        "reconstruct photos --out d --psf gaussian:5 --cameras m --truth t --holdout-every 5 --preset draft "
        "--time-limit 120s --seed 3 --device cpu --threads 2 --resume --sh-degree 2 --max-gaussians 5000 "
        "--max-size 400 --masks k --progress json --blur-space linear --loss paper"
    ).split()
    options = build_parser(words).parse_args(words)
    assert (options.holdout_every, options.time_limit, options.max_size, options.resume) == (5, 120.0, 400, True)
    words = ["reconstruct", "photos", "--out", "d"]
    defaults = build_parser(words).parse_args(words)
    assert (defaults.psf, defaults.blur_space, defaults.holdout_every, defaults.seed) == (None, "srgb", 8, 0)
    assert (defaults.preset, defaults.device, defaults.progress, defaults.loss) == ("balanced", "auto", "auto", "dgs")


def test_no_command_prints_the_help(capsys):
    assert run([]) == 2
    assert "reconstruct" in capsys.readouterr().out


def test_help_names_units_and_loads_nothing_heavy():
    code = (
        "import sys, run_dgs; run_dgs.mount_package()\n"
        "from dgs.command_line import run\n"
        "status = run(['reconstruct', '--help'])\n"
        "heavy = [m for m in ('torch', 'numba', 'scipy', 'pycolmap', 'numpy') if m in sys.modules]\n"
        "sys.exit(status or len(heavy))"
    )
    began = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "px" in done.stdout and "default: 8" in done.stdout
    assert time.perf_counter() - began < 30


def test_version(capsys):
    from dgs.core.version import VERSION

    assert run(["--version"]) == 0
    assert VERSION in capsys.readouterr().out


def test_the_manifest_has_the_same_version():
    import tomllib

    from dgs.core.version import VERSION

    manifest = ROOT / "blender_manifest.toml"
    assert tomllib.loads(manifest.read_text("utf-8"))["version"] == VERSION
