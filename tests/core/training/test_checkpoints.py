"""Checkpoints: what is written comes back, and what does not belong here is refused by name."""

import resource
import signal

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.errors import CheckpointError, OutputError
from dgs.core.training.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from dgs.core.training.origin import SAME_CAMERA, _same, origin
from dgs.core.views import SparsePoints, View

FINGERPRINT = {"settings": {"seed": 0, "steps": 10}, "photos": ["a.png", "b.png"], "blur space": "srgb"}


def arrays():
    random = np.random.default_rng(0)
    sides = {"means": (3,), "log_scales": (3,), "quaternions": (4,), "opacity_logits": (), "sh": (4, 3)}
    values = {name: random.normal(size=(50, *side)).astype(np.float32) for name, side in sides.items()}
    out = {f"{kind}.{name}": np.abs(array) for kind in ("first", "second") for name, array in values.items()}
    return {
        **{f"value.{n}": a for n, a in values.items()},
        **out,
        "pull": values["means"][:, 0],
        "views": np.ones(50, "f"),
    }


@pytest.fixture
def kept(tmp_path):
    checkpoint = Checkpoint(arrays(), FINGERPRINT, 7, 1.25, [{"step": 7, "loss": 0.5}], {"steps": 7})
    save_checkpoint(tmp_path / "kept.npz", checkpoint)
    return tmp_path / "kept.npz"


def test_round_trip(kept):
    back = load_checkpoint(kept, FINGERPRINT)
    assert (back.step, back.seconds, back.counters) == (7, 1.25, {"steps": 7})
    assert back.history == [{"step": 7, "loss": 0.5}]
    assert back.arrays.keys() == arrays().keys()
    assert all(np.array_equal(back.arrays[name], array) for name, array in arrays().items())
    assert [path.name for path in kept.parent.iterdir()] == ["kept.npz"], "no temporary file is left"


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.99])
def test_truncated(kept, share):
    content = kept.read_bytes()
    kept.write_bytes(content[: int(share * len(content))])
    with pytest.raises(CheckpointError, match=r"kept\.npz' is damaged"):
        load_checkpoint(kept, FINGERPRINT)


def test_flipped_bytes(kept):
    content = bytearray(kept.read_bytes())
    for at in range(len(content) // 3, len(content) // 3 + 40):
        content[at] ^= 0xFF
    kept.write_bytes(bytes(content))
    with pytest.raises(CheckpointError, match=r"kept\.npz' is damaged"):
        load_checkpoint(kept, FINGERPRINT)


@pytest.mark.parametrize("content", [b"not an archive at all", b"PK\x03\x04" + bytes(200), b"\x80\x04K\x01."])
def test_foreign_file(kept, content):
    kept.write_bytes(content)
    with pytest.raises(CheckpointError, match=r"kept\.npz' is damaged"):
        load_checkpoint(kept, FINGERPRINT)


def test_archive_of_something_else(kept):
    np.savez(kept, points=np.zeros(3))
    with pytest.raises(CheckpointError, match=r"kept\.npz' is damaged"):
        load_checkpoint(kept, FINGERPRINT)


@pytest.mark.parametrize(
    "change", [{"settings": {"seed": 1, "steps": 10}}, {"photos": ["a.png"]}, {"blur space": "linear"}]
)
def test_checkpoint_of_another_run_names_what_differs(kept, change):
    with pytest.raises(CheckpointError, match=f"kept\\.npz' belongs to a run with another {next(iter(change))}"):
        load_checkpoint(kept, {**FINGERPRINT, **change})


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("value.quaternions", lambda a: a[:-1]),
        ("first.means", lambda a: a[:, :2]),
        ("second.sh", lambda a: a.astype(np.float64)),
        ("value.opacity_logits", lambda a: a[:, None]),
        ("value.sh", lambda a: a[:, :3]),
        ("value.means", lambda a: a[:0]),
        ("first.sh", lambda a: np.full_like(a, np.nan)),
        ("second.means", lambda a: -a - 1),
        ("pull", lambda a: a[:7]),
        ("views", lambda a: None),
    ],
)
def test_arrays_that_do_not_agree_are_named(tmp_path, name, change):
    """Short ones ended the process in native code (status 134)."""
    changed = arrays()
    changed[name] = change(changed[name])
    if changed[name] is None:
        del changed[name]
    save_checkpoint(tmp_path / "a.npz", Checkpoint(changed, {}, 7, 1.0, [], {"steps": 7}))
    with pytest.raises(CheckpointError, match=rf"a\.npz' is damaged .*'{name}'"):
        load_checkpoint(tmp_path / "a.npz", {})


@pytest.mark.parametrize(
    ("facts", "word"),
    [
        ({"step": -1}, "step is no count"),
        ({"step": 1.5}, "step is no count"),
        ({"seconds": "1"}, "seconds is no number"),
        ({"history": [{"step": 1, "loss": "x"}]}, r"history\[0\]\.loss is no"),
        ({"history": {}}, "history is no list"),
        ({"counters": {}}, "steps is missing"),
        ({"counters": {"steps": -1}}, "steps is no count"),
        ({"fingerprint": []}, "fingerprint is no object"),
    ],
)
def test_facts_of_other_kinds_are_named(tmp_path, facts, word):
    usual = {"fingerprint": {}, "step": 7, "seconds": 1.0, "history": [], "counters": {"steps": 7}}
    save_checkpoint(tmp_path / "a.npz", Checkpoint(arrays(), **{**usual, **facts}))
    with pytest.raises(CheckpointError, match=f"a\\.npz' is damaged .*{word}"):
        load_checkpoint(tmp_path / "a.npz", {})


def test_an_array_that_declares_more_than_the_file_holds_takes_no_memory(tmp_path):
    """112 GiB were asked for, and 'use --max-size' was the advice."""
    import io
    import zipfile

    stream = io.BytesIO()
    header = {"descr": "<f4", "fortran_order": False, "shape": (2**40,)}
    np.lib.format.write_array_header_1_0(stream, header)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("pull.npy", stream.getvalue())
    with pytest.raises(CheckpointError, match="declares the shape"):
        load_checkpoint(tmp_path / "a.npz", {})


@pytest.mark.skipif(not hasattr(signal, "SIGXFSZ"), reason="needs POSIX's limit on a file's size")
def test_a_checkpoint_that_could_not_be_written_whole_leaves_the_one_before(kept):
    """The operating system stops the write in its middle, as a full disk does."""
    later = Checkpoint(arrays(), FINGERPRINT, 8, 2.0, [], {"steps": 8})
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (kept.stat().st_size // 2, before[1]))
    try:
        with pytest.raises(OutputError, match=r"kept\.npz"):
            save_checkpoint(kept, later)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert load_checkpoint(kept, FINGERPRINT).step == 7
    assert [path.name for path in kept.parent.iterdir()] == ["kept.npz"]
    save_checkpoint(kept, later)
    assert load_checkpoint(kept, FINGERPRINT).step == 8


def seen(name, shade=0, at=0.0, content=""):
    camera = Camera(name, 8, 6, 9.0, 9.0, 4.0, 3.0, np.eye(3), np.array([at, 0.0, 5.0]))
    return View(camera, np.full((6, 8, 3), shade, np.uint8), content=content)


def fingerprint(views, heldout=(), points=((0.0, 0.0, 0.0),)):
    cloud = SparsePoints(np.array(points, float), np.zeros((len(points), 3), np.uint8))
    return {**FINGERPRINT, **origin(views, heldout, cloud)}


def kept_with(tmp_path, facts):
    save_checkpoint(tmp_path / "kept.npz", Checkpoint(arrays(), facts, 7, 1.25, [], {"steps": 7}))
    return tmp_path / "kept.npz"


BEFORE = fingerprint([seen("a"), seen("b", content="1f")], [seen("c")])


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (fingerprint([seen("a", shade=1), seen("b", content="1f")], [seen("c")]), "another photo 'a'"),
        (fingerprint([seen("a"), seen("b", content="2f")], [seen("c")]), "another photo 'b'"),
        (fingerprint([seen("a"), seen("b", content="1f")], [seen("c", shade=1)]), "another photo 'c'"),
        (fingerprint([seen("a"), seen("b", at=0.001, content="1f")], [seen("c")]), "another camera of 'b'"),
        (fingerprint([seen("a"), seen("b", content="1f")], [seen("c", at=1.0)]), "another camera of 'c'"),
        (fingerprint([seen("a"), seen("b", content="1f")], [seen("c")], [(0.0, 0.0, 1e-9)]), "other points"),
        ({**BEFORE, "effects": {"haze": 1}}, "another effects"),
    ],
)
def test_a_checkpoint_of_other_photos_cameras_or_points_names_the_first(tmp_path, now, said):
    """It went on, scored on the wrong photos or in another world."""
    with pytest.raises(CheckpointError, match=said) as refused:
        load_checkpoint(kept_with(tmp_path, BEFORE), now)
    assert "without --resume" in str(refused.value)
    with pytest.raises(CheckpointError, match=said):
        load_checkpoint(kept_with(tmp_path, now), BEFORE)


def test_cameras_that_were_rounded_by_a_file_are_the_same(tmp_path):
    kept = kept_with(tmp_path, BEFORE)
    assert load_checkpoint(kept, BEFORE).step == 7
    rounded = fingerprint([seen("a", at=1e-7), seen("b", content="1f")], [seen("c")])
    assert load_checkpoint(kept, rounded).step == 7
    assert load_checkpoint(kept, {}).step == 7, "an update goes on from any"


@pytest.mark.parametrize("kept", [FINGERPRINT, {**FINGERPRINT, "contents": {}}])
def test_a_checkpoint_without_digests_is_refused(tmp_path, kept):
    with pytest.raises(CheckpointError, match="earlier version"):
        load_checkpoint(kept_with(tmp_path, kept), BEFORE)


@pytest.mark.parametrize("junk", [7, [], {"a": "x"}, {"a": [1, 2]}, {"a": None}])
def test_damaged_digests_end_in_words(tmp_path, junk):
    for key in ("contents", "cameras", "points"):
        try:
            load_checkpoint(kept_with(tmp_path, {**BEFORE, key: junk}), BEFORE)
        except CheckpointError:
            continue


@pytest.mark.parametrize("index", range(19))
def test_every_number_of_a_camera_counts(index):
    """Frame and lens by the larger side, the rotation by one, the centre by the world's extent; either way."""
    now = [80.0, 60.0, 70.0, 71.0, 40.0, 30.0, *np.eye(3).ravel(), 0.0, 0.0, -2.0, 2.0]
    scale = 80.0 if index < 6 else 1.0 if index < 15 else 5.0
    for share, same in ((0.9, True), (1.1, False), (-0.9, True), (-1.1, False)):
        kept = list(now)
        kept[index] += share * SAME_CAMERA * scale
        assert _same(kept, now, 5.0) is same
    assert not _same(now[:-1], now, 5.0) and not _same("x", now, 5.0) and not _same(None, now, 5.0)
