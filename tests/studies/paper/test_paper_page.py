"""The paper's page: verdicts follow the figures, whichever way they fall."""

import copy

import pytest
from dgs.studies.comparison import mismatch, table
from dgs.studies.paper import page as paper


def row(method, seed, psnr, red, thin, gain=1.0):
    held = {
        "psnr": psnr,
        "ssim": 0.7,
        "psnr_inside": psnr,
        "psnr_object": None,
        "edge_sharpness": 0.8,
        "degraded_psnr": 40.0,
        "bands": {
            "14-10": {"gain": gain, "correlation": 0.99, "energy": 1.0},
            "10-7": {"gain": 0.4, "correlation": 0.6, "energy": 0.5},
        },
    }
    lines = {
        name: {
            "concordance": value,
            "concordance_all_views": value,
            "true_mean": 13.0,
            "rendered_mean": 13.1,
            "views": [],
        }
        for name, value in (("red", red), ("white thin", thin))
    }
    return {
        "method": method,
        "seed": seed,
        "seconds": {"deconvolution": 1.0, "wall": 10.0, "cpu": 18.0},
        "heldout": held,
        "fitted": {"psnr": psnr + 1},
        "lines": lines,
        "depth": {"median": 0.001},
    }


def content(dgs=26.3):
    rows = [row("plain", seed, 21.5 + 0.1 * seed, 4.0, 2.0, gain=0.05) for seed in range(3)]
    rows += [row("dgs", seed, dgs + 0.1 * seed, 120 - 15 * seed, 50) for seed in range(3)]
    rows += [
        row("wiener 1e-5 v0.1", 0, 25.4, 41, 21),
        row("wiener 1e-4 v0.3", 0, 25.9, 41, 21),
        row("rl 50 v0.1", 0, 25.0, 12, 18),
    ]
    facts = {
        "set": "ball",
        "photos": 76,
        "registered": 76,
        "heldout": ["a"] * 10,
        "size": [800, 533],
        "metres": True,
        "psf": "gaussian:5",
        "blur_space": "srgb",
        "cameras": "found",
        "quick": False,
        "grid_step": 2,
        "steps": 1,
        "max_gaussians": 1,
        "variation_weight": 0.1,
        "seeds": 3,
        "poses": {"centre_px_median": 0.4, "angle_degrees_median": 0.01, "focal_percent": 0.2, "cameras": 76},
        "machine": {"processor": "P", "threads": 2, "device": "cpu"},
        "truth_low_passed_psnr": {"0.11": 25.7, "0.125": 26.6},
    }
    return {"facts": facts, "methods": table.summarised(rows, ["wiener 1e-5 v0.1"]), "rows": rows}


def wrong(lead):
    cases = {}
    for name in ("as given", "sigma given -20 %", "sigma given +20 %"):
        each = table.summarised(
            [
                row("plain", 0, 21.0, 4, 2),
                row("dgs", 0, 21.0 + lead, 50, 30),
                row("wiener measured v0.1", 0, 24.0, 9, 9),
            ]
        )["each"]
        cases[name] = each
    return {"psf": "gaussian:5", "border": 40, "seeds": 1, "quick": False, "cases": cases}


def test_medians_spreads_and_the_best_baselines():
    summary = content()["methods"]
    assert summary["each"]["dgs"]["median"]["psnr"] == pytest.approx(26.4)
    assert summary["each"]["dgs"]["spread"]["psnr"] == pytest.approx(0.0816, abs=1e-3)
    assert summary["each"]["rl 50 v0.1"]["spread"]["psnr"] is None
    assert summary["best_wiener"] == "wiener 1e-4 v0.3" and summary["best_rl"] == "rl 50 v0.1"
    assert summary["each"]["plain"]["median"]["seconds"] == pytest.approx(11.0)


def test_verdicts_are_met_where_the_figures_are():
    found = paper.verdicts(content(), wrong(1.0))
    # 26.4 against 25.7 + 0.3; against 25.4 + 0.7 (the best with the same TV); against 26.6; lines in 2 of 3 runs.
    assert [one.met for one in found] == [True, True, False, True, True, True, True]
    assert "wiener 1e-5 v0.1" in found[1].asked and "2 of 3" in found[3].measured


def test_verdicts_are_missed_where_the_figures_are_not():
    weak = content(dgs=25.8)
    for one in weak["rows"]:
        one["lines"]["red"]["concordance"] = 60
    weak["methods"]["each"]["dgs"]["median"].update({"14-10 gain": 0.8, "10-7 correlation": 0.3, "10-7 energy": 0.6})
    assert [one.met for one in paper.verdicts(weak, wrong(-0.2))] == [False] * 7


def test_what_was_not_measured_is_not_judged():
    bare = copy.deepcopy(content())
    bare["rows"] = [{**one, "lines": {}} for one in bare["rows"]]
    bare["methods"] = table.summarised([one for one in bare["rows"] if one["method"] in ("plain", "dgs")])
    found = paper.verdicts(bare, None)
    assert len(found) == 6 and found[1].met is None and found[3].met is None


def test_the_page_shows_the_papers_figures_ours_and_the_misses():
    main = paper.Chapter("The ball", "Blurred in sRGB.", content(), {"images/x.png": "A profile"})
    text = paper.page(main, [], wrong(1.0), quick=False)
    assert "| plain GS | 3.95 | 4.0 ± 0.0 |" in text and "| DGS, ours | - | 105.0" in text
    assert "**missed**" in text and "| met |" in text
    assert "![A profile](images/x.png)" in text and "Wrong" not in text
    assert text.count(table.DEFINITION) == 2
    quick = paper.page(main, [], None, quick=True)
    assert "not results" in quick and "not judged (quick)" in quick and "**missed**" not in quick


def test_the_mismatch_table_has_a_row_for_every_case():
    lines = mismatch.table_lines(wrong(1.5))
    assert len(lines) == 5 and "+1.50" in lines[2]
    names = [case.name for case in mismatch.cases(5.0)]
    assert len(names) == len(set(names)) == 11
    assert {case.given for case in mismatch.cases(5.0)} == {4.0, 4.5, 5.0, 5.5, 6.0}
    assert len(mismatch.cases(5.0, quick=True)) == 5
