"""What was accepted without a word, hung, or was said to have another cause than it had."""

import struct
import subprocess
import sys
from pathlib import Path

import dgs
import numpy as np
import pytest
from dgs.command_line.main import run
from dgs.core.errors import DegenerateMotion, FormatError, PhotoError, PsfError
from dgs.core.formats.colmap import write_model
from dgs.core.formats.gaussians import unusable, write_gaussians
from dgs.core.imaging.kernel_files import read_kernel
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.photos.load import load_photos
from dgs.core.pipeline.blind import given_spreads
from dgs.core.pipeline.update import _new_photos
from dgs.core.progress import Silent
from dgs.core.reconstruction import no_points
from dgs.core.sfm.given import load_cameras
from dgs.core.twin.folder import TwinFolder
from dgs.core.twin.opened import open_twin
from dgs.studies.stability.damage import png
from dgs.studies.stability.fuzzed_samples import cameras, cloud
from dgs.studies.stability.fuzzed_state import write_twin
from PIL import Image


class Notes(Silent):
    def __init__(self):
        self.heard = []

    def note(self, text):
        self.heard.append(text)


def folder_of(path, *names):
    path.mkdir()
    for index, name in enumerate(names):
        Image.new("RGB", (40, 30), (index, 9, 9)).save(path / name)
    return path


@pytest.mark.parametrize("text", ["gaussian:1e9", "gaussian:1e9,2,0", "gaussian:2,1e300,45"])
def test_a_psf_wider_than_any_photo_is_refused_at_once(text):
    with pytest.raises(PsfError, match="wider than any photo"):
        parse_psf(text)


def test_a_negative_seed_is_refused(capsys):
    assert run(["update", "twin", "photos", "--seed", "-1"]) == 2
    assert "--seed" in capsys.readouterr().err


def test_a_header_that_declares_terabytes_is_a_damaged_file(tmp_path):
    """'Use --max-size' was the advice."""
    with (tmp_path / "k.npy").open("wb") as file:
        header = {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
        np.lib.format.write_array_header_1_0(file, header)
    with pytest.raises(PsfError, match="it was cut off"):
        read_kernel(tmp_path / "k.npy")


def test_fits_of_a_negative_size_is_damaged_and_not_dark(tmp_path):
    cards = ["SIMPLE  = T", "BITPIX  = -32", "NAXIS   = 2", "NAXIS1  = -5", "NAXIS2  = 5", "END"]
    (tmp_path / "k.fits").write_bytes("".join(card.ljust(80) for card in cards).ljust(2880).encode() + bytes(2880))
    with pytest.raises(PsfError, match="has the shape"):
        read_kernel(tmp_path / "k.fits")


@pytest.mark.parametrize("name", ["k.tif", "k.png", "x" * 400 + ".npy"])
def test_kernels_that_are_none(tmp_path, name):
    if len(name) < 255:
        (tmp_path / name).write_bytes(b"II*\0\x08\0\0\0" if name == "k.tif" else b"\x89PNG\r\n\x1a\n")
    with pytest.raises(PsfError):
        read_kernel(tmp_path / name)


def test_a_png_that_unpacks_to_gigabytes_is_no_kernel(tmp_path):
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)), (b"IDAT", bytes(100)), (b"IEND", b"")]
    (tmp_path / "k.png").write_bytes(png(chunks))
    with pytest.raises(PsfError, match=r"k\.png' cannot be read: (it declares|Image size)"):
        read_kernel(tmp_path / "k.png")


DEEP = "[" * 100_000 + "]" * 100_000


@pytest.mark.parametrize(
    ("file", "text"),
    [
        *((name, text) for name in ("report.json", "twin.json") for text in (DEEP, "[1]", "3", '"x"', "null")),
        ("report.json", '{"settings": {"run": {"psf": 7, "photos": [], "out": {}}}}'),
        ("twin.json", '{"held": 3, "psf": [], "updates": {"x": 1}}'),
        ("twin.json", '{"held": ["a.png"], "psf": {"b.png": 5}, "updates": [7]}'),
    ],
)
def test_what_a_twin_keeps_is_checked_before_it_is_used(tmp_path, file, text, capsys):
    """Wrong types and brackets in brackets were tracebacks, of both commands that open a twin."""
    write_twin(tmp_path)
    (tmp_path / "twin" / file).write_text(text)
    for words in (["next-view", "TWIN"], ["update", "TWIN", "PHOTOS"]):
        places = {"TWIN": str(tmp_path / "twin"), "PHOTOS": str(tmp_path / "photos")}
        assert run([places.get(word, word) for word in words]) == 2
        said = capsys.readouterr().err
        assert "Traceback" not in said and "bug" not in said and f"{file}' is damaged" in said, said[-300:]


@pytest.mark.parametrize("text", [DEEP, "[1]", "3", '{"*": 7}', '{"a.png": ["gaussian:2"]}'])
def test_lists_of_point_spreads_that_are_none(tmp_path, text):
    (tmp_path / "psf.json").write_text(text)
    with pytest.raises(PsfError):
        given_spreads(f"per-photo:{tmp_path / 'psf.json'}")


def test_kernels_that_run_when_a_command_has_failed_say_nothing():
    """What an update compiles beside its photos printed a traceback behind the line that said what was wrong."""
    code = (
        "import sys; sys.path.insert(0, '.'); import run_dgs; run_dgs.mount_package(); import threading, time\n"
        "from dgs.core import compiled; compiled.set_threads(2); seen = []\n"
        "def late():\n"
        "    time.sleep(0.5); compiled.run(lambda begin, end: seen.extend(range(begin, end)), 100)\n"
        "    print(sorted(seen) == list(range(100)))\n"
        "threading.Thread(target=late).start()\n"
    )
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=Path(dgs.__path__[0]))
    assert done.stdout.strip() == "True" and done.stderr == ""


def test_cameras_at_one_place_are_refused(tmp_path):
    photos = load_photos(folder_of(tmp_path / "photos", "a.png", "b.png"), None, Silent())
    pair = cameras()
    load_cameras_of = lambda model: load_cameras(model, photos)  # noqa: E731
    write_model(tmp_path / "good", pair, no_points())
    load_cameras_of(tmp_path / "good")
    write_model(tmp_path / "same", dict.fromkeys(pair, pair["a.png"]), no_points())
    with pytest.raises(DegenerateMotion, match="2 cameras of the photos at one place"):
        load_cameras_of(tmp_path / "same")


def test_gaussians_that_are_not_finite_are_counted():
    good = cloud()
    assert unusable(good) == ""
    good.means[::2] = np.nan
    assert unusable(good) == "20 of 40 Gaussians are not finite and are not drawn"
    good.sh[:, 0, 2] = np.inf
    with pytest.raises(FormatError, match="None of the 40"):
        unusable(good)


def test_render_says_that_half_of_a_file_is_not_drawn(tmp_path, capsys):
    half = cloud()
    half.means[::2] = np.nan
    write_gaussians(tmp_path / "a.ply", half)
    write_model(tmp_path / "model", cameras(), no_points())
    words = ["render", tmp_path / "a.ply", "--cameras", tmp_path / "model", "--out", tmp_path / "out"]
    assert run([str(word) for word in words]) == 0
    said = "".join(capsys.readouterr())
    assert "20 of 40 Gaussians are not finite" in said


def test_pictures_that_are_not_read_are_named(tmp_path):
    """GIF and HEIC files were left out silently."""
    photos = folder_of(tmp_path / "photos", "a.png", "b.png", "c.gif")
    (photos / "d.HEIC").write_bytes(b"")
    notes = Notes()
    loaded = load_photos(photos, None, notes)
    assert [photo.name for photo in loaded] == ["a.png", "b.png"]
    assert any("c.gif" in text for text in notes.heard) and any("d.HEIC" in text for text in notes.heard)
    only = folder_of(tmp_path / "only", "c.gif")
    with pytest.raises(PhotoError, match=r"no photos \(1 of kinds that are not read: c\.gif\)"):
        load_photos(only, None, notes)


def test_heic_is_read_where_its_package_is(tmp_path, monkeypatch):
    photos = folder_of(tmp_path / "photos", "a.png", "b.png")
    (photos / "a.png").rename(photos / "a.heic")
    package = tmp_path / "site"
    package.mkdir()
    (package / "pillow_heif.py").write_text("def register_heif_opener():\n    pass\n")  # Pillow looks at the content
    monkeypatch.syspath_prepend(package)
    notes = Notes()
    assert [photo.name for photo in load_photos(photos, None, notes)] == ["a.heic", "b.png"] and not notes.heard


def test_a_large_photo_brings_no_warning_of_pillow(tmp_path):
    Image.new("RGB", (40, 30)).save(tmp_path / "a.png")
    code = (
        "import sys; sys.path.insert(0, '.'); import run_dgs; run_dgs.mount_package(); from pathlib import Path;"
        "from PIL import Image; from dgs.core.photos.load import load_photo; Image.MAX_IMAGE_PIXELS = 1000;"
        f"load_photo(Path({str(tmp_path / 'a.png')!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(dgs.__path__[0])
    )
    assert done.stderr == ""


def test_photos_that_the_twin_keeps_are_no_new_ones(tmp_path):
    """A new photo put into T/photos ended in 'check the disk'."""
    folder = TwinFolder(tmp_path)
    folder_of(folder.new_photo_folder, "new.png")
    with pytest.raises(PhotoError, match="where the twin keeps its photos"):
        _new_photos(folder.new_photo_folder, None, folder, None, Silent())


def test_a_twin_without_cameras_is_said_to_be_one(tmp_path):
    """'Check the path given with --cameras' was the advice, though none was given."""
    folder = TwinFolder(tmp_path / "twin")
    folder.save_twin(cloud())
    photos = folder_of(tmp_path / "photos", "a.png", "b.png")
    folder.save_report({"settings": {"run": {"psf": "none", "photos": str(photos), "out": str(folder.path)}}})
    with pytest.raises(FormatError, match="lacks cameras/"):
        open_twin(folder.path, Silent())
