"""The page: self-contained, complete, and small; the schema: documented and strict."""

import copy
import re
from html.parser import HTMLParser
from pathlib import Path

import dgs
import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.imaging.formation.focus import OUT_OF_FOCUS
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.report.charts import Axis, Marker, line_chart
from dgs.core.report.foci import drawn_foci
from dgs.core.report.kernels import drawn_kernels
from dgs.core.report.page import exposures, page, write_page
from dgs.core.report.paths import drawn_paths
from dgs.core.report.pictures import ViewPictures, embedded, spread
from dgs.core.report.schema import FIELDS, markdown_table, problems
from dgs.core.report.words import limits, simulated

REPORT = {
    "schema": 1,
    "status": "done",
    "photos": {
        "folder": "photos & <b>more",
        "given": 9,
        "registered": 8,
        "unregistered": ["lost.jpg"],
        "size": [64, 48],
        "scale": 1.0,
        "background": None,
        "transparent": 0,
    },
    "cameras": {
        "source": "sfm",
        "file": None,
        "focal_px": 70.0,
        "reprojection_error_px": None,
        "points": 120,
        "points_scattered": False,
        "world_offset": None,
        "refined": None,
    },
    "medium": {"psf": "gaussian:5", "blur_space": "srgb", "per_photo": {}, "per_photo_sigma": None},
    "gaussians": 1234,
    "steps": 100,
    "effects": [
        {
            "name": "haze",
            "on": True,
            "why": "confirmed: it gains",
            "gain_db": 0.25,
            "gain_error_db": 0.05,
            "seconds": 9.0,
            "parameters": {"veil": [0.5, 0.5, 0.5]},
            "evidence": {
                "name": "haze",
                "needed": True,
                "confidence": 0.99,
                "seconds": 1.0,
                "evidence": "Fades.",
                "estimate": {"value": 0.4, "error": 0.02, "unit": "optical depth", "smallest": 0.08},
            },
        },
        {
            "name": "exposure",
            "on": False,
            "why": "not needed",
            "gain_db": None,
            "gain_error_db": None,
            "seconds": 0.1,
            "parameters": None,
            "evidence": None,
        },
    ],
    "seconds": {
        "start": None,
        "photos": 1.0,
        "sfm": 2.0,
        "surface": 0.6,
        "refine": None,
        "effects": 9.1,
        "compile": None,
        "prepare": None,
        "train": 61.0,
        "save": 1.0,
        "total": 3700.0,
    },
    "predicted": None,
    "peak_memory_mb": 300.5,
    "heldout": {
        "names": ["a.png"],
        "unregistered": [],
        "every": 8,
        "in_sfm": True,
        "moved_px": 0.31,
        "degraded": {"psnr": 38.25, "ssim": 0.98, "psnr_matched": 38.5, "psnr_halves": None},
        "sharp": {"psnr": 25.5, "ssim": 0.7, "psnr_inside": 26.0},
        "truth_low_passed_psnr": 25.7,
        "bands": [
            {"coarsest": 20.0, "finest": 14.0, "gain": 0.9, "correlation": 0.95, "energy": 0.94},
            {"coarsest": 14.0, "finest": 10.0, "gain": 0.5, "correlation": 0.6, "energy": 0.8},
        ],
        "edge_sharpness": 0.8,
        "views": [],
    },
    "verdict": {
        "level": "doubtful",
        "sentence": "The twin predicts only roughly photos that it has not seen.",
        "unseen": 0.05,
        "fitted": 0.02,
        "views": ["a & b.jpg: 80 % explained, most of the error in the upper left"],
        "help": ["Take photos between a.jpg and b.jpg"],
    },
    "resolvable_period_px": 9.03,
    "settings": {"run": {"psf": "gaussian:5", "cameras": None}, "training": {"steps": 200, "sh_degree": 1}},
    "versions": {"dgs": "0.1.0"},
    "machine": {"cores": 2},
    "counters": {"culled": 3},
    "notes": ["A <note>"],
    "history": [
        {"step": 0, "seconds": 0.0, "loss": 1.0, "heldout_psnr": 20.0},
        {"step": 100, "seconds": 5.0, "loss": 0.1, "heldout_psnr": 30.0},
    ],
}


def pictures(count=1, size=(48, 64), truth=True):
    random = np.random.default_rng(0)

    def one():
        return random.integers(0, 255, (*size, 3), dtype=np.uint8)

    score = {"psnr": 30.0, "ssim": 0.9}
    return [
        ViewPictures(
            f"view {i}.png",
            True,
            one(),
            one(),
            one(),
            one() if truth else None,
            {"degraded": score, "sharp": score if truth else None},
        )
        for i in range(count)
    ]


def cameras():
    return {
        f"c{i}.png": Camera(f"c{i}.png", 64, 48, 70.0, 70.0, 32.0, 24.0, np.eye(3), np.array([0.1 * i, 0.0, 0.0]))
        for i in range(4)
    }


class Tags(HTMLParser):
    """Collects addresses, and checks that tags are balanced."""

    def __init__(self):
        super().__init__()
        self.addresses, self.open, self.images = [], [], 0

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.addresses += [v for k, v in values.items() if k in ("src", "href")]
        self.images += tag == "img" and "src" in values
        if tag not in ("meta", "img", "input", "br", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def parsed(text):
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    return tags


def test_the_page_needs_no_other_file():
    tags = parsed(page(REPORT, pictures(2), parse_psf("gaussian:5"), cameras()))
    assert tags.images == 8
    assert all(address.startswith("data:image/jpeg;base64,") for address in tags.addresses)
    assert "http" not in re.sub(r"http://www.w3.org/\S+", "", page(REPORT, [], None, cameras()))


def test_the_page_says_what_a_user_must_know():
    text = page(REPORT, pictures(), parse_psf("gaussian:5"), cameras())
    for words in (
        "25.50",
        "38.25",
        "Detail finer than about 9.03 px",
        "took part in finding the cameras",
        "lost.jpg",
        "1\u202f234",
        "61 s",
        "1 h 1 min",
        "A &lt;note&gt;",
        "photos &amp; &lt;b&gt;more",
        "predicts only roughly photos",
        "a &amp; b.jpg: 80 % explained",
        "Take photos between",
    ):
        assert words in text, words
    assert "prefers-color-scheme: dark" in text
    assert text.count("<svg") == 5  # loss, accuracy, bands, transfer, map


@pytest.mark.parametrize("status", ["cancelled", "time limit"])
def test_an_unfinished_run_says_so(status):
    report = copy.deepcopy(REPORT)
    report["status"] = status
    assert "100 of 200 steps" in page(report, pictures(), None, cameras())


def test_a_run_without_anything_optional_still_makes_a_page():
    report = copy.deepcopy(REPORT)
    report["heldout"].update(
        names=[],
        degraded={"psnr": None, "ssim": None},
        bands=[],
        truth_low_passed_psnr=None,
        sharp={"psnr": None, "ssim": None, "psnr_inside": None},
        edge_sharpness=None,
    )
    report.update(history=[], counters={}, notes=[], peak_memory_mb=None, resolvable_period_px=2.0)
    report["medium"]["psf"] = "none"
    text = page(report, pictures(truth=False), None, cameras())
    parsed(text)
    assert "None" not in re.sub(r"data:image[^\"]*", "", text)


def test_pictures_give_way_to_the_budget():
    views = pictures(6, (600, 800))
    small = embedded(views, 2_000_000)
    assert sum(len(uri) for view in small for uri in view.values()) < 2_700_000
    assert len(small) == 6 and set(small[0]) == {"photo", "twin", "degraded", "truth"}


def test_the_page_is_written_whole(tmp_path):
    write_page(tmp_path / "report.html", REPORT, pictures(), None, cameras())
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_spread_keeps_first_and_last():
    assert spread(3, 6) == [0, 1, 2]
    assert spread(10, 4) == [0, 3, 6, 9]


def test_charts_leave_out_what_cannot_be_drawn():
    nan = float("nan")
    svg = line_chart(
        "t",
        [("a", [(0, nan), (1, 1.0), (2, 0.0), (3, 10.0)])],
        Axis("x"),
        Axis("y", logarithmic=True),
        [Marker("m", x=2.0), Marker("n", y=5.0)],
    )
    assert "nan" not in svg and svg.count("<circle") == 2 and svg.count('class="marker"') == 2
    assert line_chart("t", [("a", [(0, nan)])], Axis("x"), Axis("y")) == ""
    flat = line_chart("t", [("a", [(0, 1.0), (1, 1.0)])], Axis("x"), Axis("y"))
    assert "nan" not in flat and "inf" not in flat


def test_the_schema_is_documented():
    text = (Path(dgs.__file__).parent / "docs" / "report.md").read_text("utf-8")
    assert markdown_table() in text


def test_the_example_is_valid_and_damage_is_found():
    assert problems(REPORT) == []
    for field in FIELDS:
        report = copy.deepcopy(REPORT)
        *parents, last = field.path.split(".")
        holder = report
        for name in parents:
            holder = holder[name]
        del holder[last]
        assert any(field.path in problem for problem in problems(report)), field.path
    report = copy.deepcopy(REPORT)
    report["gaussians"] = "many"
    assert problems(report) == ["gaussians is str, not integer"]


def test_learned_exposures_are_drawn_and_listed():
    report = copy.deepcopy(REPORT)
    assert "Exposure of each photo" not in page(report, pictures(), None, cameras())
    exposure = report["effects"][1]
    exposure.update(on=True, parameters={"b.png": [0.8, 0.8, 0.81], "a.png": [1.25, 1.25, 1.234]})
    report["heldout"]["degraded"]["psnr_halves"] = 41.125
    assert exposures(report) == {"a.png": [1.25, 1.25, 1.234], "b.png": [0.8, 0.8, 0.81]}
    text = page(report, pictures(), None, cameras())
    assert "Exposure of each photo" in text and "Exposure of all 2 photos" in text and "1.234" in text
    assert "41.12 <small>dB" in text and "exposed as expected of them" in text


def test_learned_paths_are_drawn():
    report = copy.deepcopy(REPORT)
    assert "Camera paths" not in page(report, pictures(), None, cameras())
    straight = [[0.0] * 6, [0.0, 0.0, 0.0, 0.0, 0.005, 0.0]]
    row = {**copy.deepcopy(report["effects"][1]), "name": "motion", "on": True}
    row["parameters"] = {"unit": 2.0, "twists": {"b.png": [[0.0] * 6, [0.02] + [0.0] * 5], "a.png": straight}}
    report["effects"].append(row)
    focal = report["cameras"]["focal_px"]
    found = drawn_paths(report)
    assert list(found) == ["a.png", "b.png"]
    assert found["a.png"].length == pytest.approx(0.01 * focal) and found["b.png"].length == pytest.approx(0.02 * focal)
    text = page(report, pictures(), None, cameras())
    assert "Camera paths of all 2 photos" in text and text.count('aria-label="path"') == 2
    assert "contrast of its own" not in text
    row["parameters"] |= {"curve": [-0.24, 0.69], "curve_error": [0.02, 0.04]}
    text = page(report, pictures(), None, cameras())
    assert "toe -0.24, shoulder 0.69 (standard errors 0.02 and 0.04)" in " ".join(text.split())
    row["parameters"]["curve"] = [0.08, 0.12]
    assert "contrast of its own" not in page(report, pictures(), None, cameras())


def test_photos_that_effects_blurred_are_not_called_sharp():
    report = copy.deepcopy(REPORT)
    report["medium"]["psf"], report["resolvable_period_px"] = "none", 2.0
    text = page(report, pictures(), None, cameras())
    assert "taken as sharp" in text and "Nothing was blurred" in text
    report["effects"] += [{**copy.deepcopy(report["effects"][1]), "name": n, "on": True} for n in ("motion", "defocus")]
    for row in report["effects"][-2:]:
        row["parameters"] = {"unit": 2.0}
    text = " ".join(page(report, pictures(), None, cameras()).split())
    assert "photos, shaken and partly out of focus, became a twin" in text
    assert "taken as sharp" not in text and "Nothing was blurred" not in text
    assert "each was blurred in its own way" in text and "the detail that its own blur took" in text
    report["medium"]["psf"] = "gaussian:5"
    text = " ".join(page(report, pictures(), None, cameras()).split())
    assert "blurred by <code>gaussian:5</code> and shaken and partly out of focus, became" in text


def test_learned_foci_are_drawn():
    report = copy.deepcopy(REPORT)
    assert "Focus of all" not in page(report, pictures(), None, cameras())
    row = {**copy.deepcopy(report["effects"][1]), "name": "defocus", "on": True}
    photos = {"d.png": [0.0, 1.0, 0.0, 9.0], "c.png": [0.01, 0.9, 0.0, 0.9], "b.png": [0.01, 0.5, 0.0, 0.01]}
    row["parameters"] = {"unit": 2.0, "photos": {**photos, "a.png": [0.01, 1.25, 0.0, 0.02]}}
    report["effects"].append(row)
    found = drawn_foci(report)
    assert list(found) == ["a.png", "b.png", "c.png", "d.png"]
    said = [focus.said for focus in found.values()]
    assert said == ["1.6 ± 0.026", "4 ± 0.08", "not identifiable", "sharp everywhere"]
    diagonal = np.hypot(*report["photos"]["size"])
    assert found["a.png"].scale == pytest.approx(4 * 0.01 * diagonal * 2.0)
    text = page(report, pictures(), None, cameras())
    assert "Focus of all 4 photos" in text and text.count('aria-label="focus"') == 4
    for error, said in ((0.0, "not identifiable: too flat"), (0.1, "sharp everywhere")):
        row["parameters"]["photos"] = {"a.png": [0.0, 1.0, error, error]}
        assert drawn_foci(report)["a.png"].said == said


def test_free_kernels_are_drawn():
    report = copy.deepcopy(REPORT)
    assert "Free kernels of all" not in page(report, pictures(), None, cameras())
    row = {**copy.deepcopy(report["effects"][1]), "name": "kernels", "on": True}
    sharp, double = [1.0] + [0.0] * 9, [0.0] * 4 + [0.5, 0.0, 0.5] + [0.0] * 3
    row["parameters"] = {"pitch": 0.01, "photos": {"b.png": double, "a.png": sharp}}
    report["effects"].append(row)
    found = drawn_kernels(report)
    pitch = 0.01 * np.hypot(*report["photos"]["size"])
    assert list(found) == ["a.png", "b.png"] and found["a.png"].width == 0.0
    assert found["b.png"].width == pytest.approx(pitch * np.sqrt(0.5))
    assert found["b.png"].svg.count('fill-opacity="1.00"') == 2 and found["a.png"].svg.count("<rect") == 2
    text = page(report, pictures(), None, cameras())
    assert "Free kernels of all 2 photos" in text and text.count('aria-label="kernel"') == 2
    assert found["b.png"].said == f"{pitch * np.sqrt(0.5):.1f} px"  # (a report of before: no errors)


def test_a_kernel_says_how_sure_it_is():
    """An interval, no more than a bound where none may be, or that nothing is known; what may be dark is a frame."""
    report = copy.deepcopy(REPORT)
    row = {**copy.deepcopy(report["effects"][1]), "name": "kernels", "on": True}
    double = [0.0] * 4 + [0.5, 0.1, 0.4] + [0.0] * 3
    row["parameters"] = {
        "pitch": 0.01,
        "photos": dict.fromkeys(("a.png", "b.png", "c.png"), double),
        "errors": dict.fromkeys(("a.png", "b.png", "c.png"), [0.06] * 10),
        "widths": {"a.png": [0.006, 0.005, 0.007], "b.png": [0.002, 0.0, 0.004], "c.png": [0.005, 0.001, 0.007]},
    }
    report["effects"].append(row)
    found, diagonal = drawn_kernels(report), np.hypot(*report["photos"]["size"])
    assert found["a.png"].said == f"{0.006 * diagonal:.1f} px ({0.005 * diagonal:.1f} to {0.007 * diagonal:.1f})"
    assert found["b.png"].said == f"at most {0.004 * diagonal:.1f} px"
    assert found["c.png"].said == "not identifiable"
    # The middle holds two weights: 0.1 is within twice their error.
    assert found["a.png"].svg.count('fill="currentColor"') == 2 and found["a.png"].svg.count("<rect") == 4
    assert found["a.png"].said in page(report, pictures(), None, cameras())


def test_every_effect_has_its_line():
    text = page(REPORT, pictures(), None, cameras())
    assert "Effects besides the blur" in text and "+0.25 ± 0.05 dB" in text and "Fades." in text
    assert "light that is lost with depth" in text and "Haze: light that the medium adds, absorbs" not in text
    assert "Effects besides the blur" not in page({**REPORT, "effects": []}, pictures(), None, cameras())


def test_glass_says_where_it_stands():
    report = copy.deepcopy(REPORT)
    found = {"angle": 0.79, "angle_error": 0.01, "distance": 0.371, "distance_error": 0.002}
    row = {**report["effects"][1], "name": "glass", "on": True}
    row["parameters"] = {**found, "width_nearest": 1.5, "width_farthest": 5.0}
    report["effects"].append(row)
    blur = simulated(report)[0]
    for words in ("0.371 ± 0.002", "0.79 degrees", "1.50 px wide on what is nearest", "5.00 px"):
        assert words in blur, words
    row["parameters"] |= {"tilt_right": -25.0, "tilt_right_error": 0.0, "tilt_down": 4.5, "tilt_down_error": 15.02}
    blur = simulated(report)[0]
    assert "right edge turned towards the camera by -25 degrees and its lower edge by 4.5 ± 15 degrees" in blur


def test_a_report_says_how_much_of_the_twin_was_never_in_focus():
    report = copy.deepcopy(REPORT)
    report["effects"][0] |= {"name": "defocus", "on": True}
    assert not any("no photo is in focus" in line for line in limits(report))
    report["counters"] = {**report["counters"], OUT_OF_FOCUS: report["gaussians"] // 4}
    assert any(line.startswith("25% of the twin's Gaussians lie where no photo is in focus") for line in limits(report))
