"""The real command line in a process of its own: results, bad input, and being stopped."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import dgs
import numpy as np
import pytest
from dgs.core.formats.ply import read_ply
from dgs.core.report.schema import problems
from dgs.tests.command_line.scene import HEIGHT, SIGMA, WIDTH, write_scene
from PIL import Image

ROOT = Path(dgs.__file__).parent
PSF = f"gaussian:{SIGMA}"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("a set") / "ümläut"
    write_scene(folder)
    return folder


def command(*arguments) -> list[str]:
    return [sys.executable, str(ROOT / "run_dgs.py"), *map(str, arguments)]


def execute(*arguments) -> subprocess.CompletedProcess:
    return subprocess.run(command(*arguments), capture_output=True, text=True, timeout=300, encoding="utf-8")


@pytest.fixture(scope="module")
def finished(scene):
    """One whole run, shared by the tests that only look."""
    done = execute(
        "reconstruct",
        scene / "photos",
        "--out",
        scene / "out",
        "--psf",
        PSF,
        "--cameras",
        scene / "model",
        "--truth",
        scene / "sharp",
        "--preset",
        "draft",
        "--max-gaussians",
        3000,
        "--holdout-every",
        4,
        "--sh-degree",
        0,
        "--progress",
        "json",
    )
    assert done.returncode == 0, done.stderr
    return scene / "out", [json.loads(line) for line in done.stdout.splitlines()]


def test_all_results_are_there(finished, scene):
    out, events = finished
    report = json.loads((out / "report.json").read_text("utf-8"))
    assert problems(report) == []
    assert report["photos"]["given"] == report["photos"]["registered"] == 9
    assert report["cameras"]["source"] == "given" and report["cameras"]["focal_px"] == pytest.approx(180)
    assert report["medium"] == {"psf": PSF, "blur_space": "srgb", "per_photo": {}, "per_photo_sigma": None}
    assert report["heldout"]["names"] == ["phöto 00.png", "phöto 04.png", "phöto 08.png"]
    assert report["heldout"]["in_sfm"] is False
    assert len(read_ply(out / "twin.ply")) == report["gaussians"] <= 3000
    assert (out / "report.html").stat().st_size < 10e6
    assert {e["name"] for e in events if e["event"] == "stage"} >= {"photos", "train", "save"}
    assert events[-1]["event"] == "done" and Path(events[-1]["result"]["twin"]).is_file()


def test_the_twin_is_sharper_than_the_photos(finished, scene):
    """The score in the report is that of the files, and better than the blurred photo's own."""
    from dgs.core.evaluation.metrics import psnr

    def pixels(path):
        return np.asarray(Image.open(path), float) / 255

    out, _ = finished
    report = json.loads((out / "report.json").read_text("utf-8"))
    names = report["heldout"]["names"]
    assert sorted(p.name for p in (out / "renders").iterdir()) == names
    twin = [psnr(pixels(out / "renders" / n), pixels(scene / "sharp" / n)) for n in names]
    photo = [psnr(pixels(scene / "photos" / n), pixels(scene / "sharp" / n)) for n in names]
    assert report["heldout"]["sharp"]["psnr"] == pytest.approx(np.mean(twin), abs=0.01)
    assert np.mean(twin) > np.mean(photo)


def test_render_repeats_the_twin_from_the_files(finished, scene, tmp_path):
    out, _ = finished
    done = execute("render", out / "twin.ply", "--cameras", out / "cameras", "--out", tmp_path, "--progress", "none")
    assert done.returncode == 0 and done.stdout == done.stderr == ""
    assert len(list(tmp_path.glob("*.png"))) == 9
    with Image.open(tmp_path / "phöto 04.png") as image:
        assert image.size == (WIDTH, HEIGHT)


def assert_one_line(done, *words):
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    for word in words:
        assert word in done.stderr


@pytest.mark.parametrize("case", ["missing", "empty", "one", "truncated", "file"])
def test_bad_photos_are_one_line(case, scene, tmp_path, capfd):
    """One of them as a user gives it, and the others in this process: starting one takes seconds."""
    from dgs.command_line import run

    photos = tmp_path / "phötos"
    if case != "missing":
        photos.mkdir()
    if case == "file":
        photos = scene / "photos" / "phöto 00.png"
    if case == "one":
        (photos / "a.png").write_bytes((scene / "photos" / "phöto 00.png").read_bytes())
    if case == "truncated":
        for i in range(3):
            (photos / f"{i}.png").write_bytes((scene / "photos" / "phöto 00.png").read_bytes()[:300])
    words = ["reconstruct", photos, "--out", tmp_path / "out", "--progress", "none"]
    if case == "truncated":
        done = execute(*words)
    else:
        status = run([str(word) for word in words])
        done = subprocess.CompletedProcess(words, status, *capfd.readouterr())
    assert_one_line(done, photos.name)


def test_bad_requests_are_found_before_any_work(scene, tmp_path, capfd):
    """In this process, because each of them ends before anything is loaded."""
    from dgs.command_line import run

    (tmp_path / "file").write_text("x")
    base = ["reconstruct", str(scene / "photos"), "--progress", "none", "--out"]
    good = str(tmp_path / "out")
    for arguments, word in [
        ([*base, good, "--psf", "gauss:5"], "gauss:5"),
        ([*base, good, "--psf", f"file:{tmp_path / 'no.npy'}"], "no.npy"),
        ([*base, str(tmp_path / "file")], "file"),
        ([*base, good, "--truth", str(tmp_path / "nowhere")], "nowhere"),
        ([*base, good, "--masks", str(tmp_path / "nomasks")], "nomasks"),
        ([*base, good, "--cameras", str(tmp_path / "nomodel")], "nomodel"),
        (["render", str(tmp_path / "file"), "--cameras", good, "--out", good], "file"),
        (["render", str(tmp_path / "none.ply"), "--cameras", good, "--out", good], "none.ply"),
    ]:
        assert run(arguments) == 2, arguments
        error = capfd.readouterr().err
        assert error.count("\n") == 1 and word in error, error


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_stopping_keeps_the_twin_so_far(scene, tmp_path):
    child = subprocess.Popen(
        command(
            "reconstruct",
            scene / "photos",
            "--out",
            tmp_path,
            "--psf",
            PSF,
            "--cameras",
            scene / "model",
            "--preset",
            "fine",
            "--max-gaussians",
            400,
            "--progress",
            "json",
        ),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
    )
    for line in child.stdout:
        event = json.loads(line)
        if event["event"] == "advance" and event["stage"] == "train":
            child.send_signal(signal.SIGINT)
            break
    rest, errors = child.communicate(timeout=120)
    assert child.returncode == 130, errors
    assert json.loads(rest.splitlines()[-1])["status"] == 130
    report = json.loads((tmp_path / "report.json").read_text("utf-8"))
    assert report["status"] == "cancelled" and report["steps"] < report["settings"]["training"]["steps"]
    assert len(read_ply(tmp_path / "twin.ply")) == report["gaussians"]
    assert "--resume" in errors
