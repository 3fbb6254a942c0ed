"""A new effect is found wherever effects are listed, with nothing more than its file and its line."""

import re
from pathlib import Path

import dgs
import numpy as np
import pytest
import torch
from dgs.benchmarks import effects as validation
from dgs.benchmarks.effect_scenes import Truth, degrade, make_scene
from dgs.command_line import run
from dgs.command_line.inspect_command import table
from dgs.core.effects import registry
from dgs.core.effects.choices import effect_items, effects_help
from dgs.core.effects.inspect import inspect_photos
from dgs.core.effects.spec import EffectSpec, EffectWords, Switch
from dgs.core.errors import DgsError
from dgs.core.imaging.formation.effect import Shot
from dgs.core.imaging.medium import Medium
from dgs.core.photos.undistort import undistorted_views
from dgs.core.pipeline.effects.ablation import TrialTerms
from dgs.core.pipeline.effects.choose import choose_effects, proposed
from dgs.core.pipeline.effects.decision import parse_effects
from dgs.core.progress import Silent
from dgs.core.report.words import not_simulated, simulated
from dgs.core.training.settings import TrainingSettings
from dgs.studies.tradeoff.knobs import _all
from dgs.tests.core.effects import toy

REPORT = {
    "medium": {"blur_space": "srgb", "psf": "none", "per_photo": {}, "per_photo_sigma": None},
    "settings": {"training": {"sh_degree": 1}},
    "cameras": {"source": "given"},
}


def reported(name: str, on: bool) -> dict:
    return {**REPORT, "effects": [{"name": name, "on": on}]}


@pytest.fixture
def with_toy(monkeypatch):
    monkeypatch.setattr(registry, "EFFECTS", (*registry.EFFECTS, toy.SPEC))


@pytest.fixture(scope="module")
def photos():
    scene = make_scene(3, width=96, height=64, views=6, finer=1)
    return validation.photo_set(scene, degrade(scene, Truth(), seed=1))


def test_the_command_line_offers_and_takes_it(with_toy, capsys):
    assert run(["reconstruct", "--help"]) == 0
    assert "saturation, dust (auto,haze" in re.sub(r"\s+", " ", capsys.readouterr().out)
    assert parse_effects("dust") == ("named", ("dust",)) and parse_effects("auto,-dust") == ("auto", ("-dust",))
    with pytest.raises(DgsError) as caught:
        parse_effects("fog")
    assert "dust" in caught.value.way_out


def test_a_name_that_is_none_ends_a_run_before_any_work(tmp_path, capsys):
    assert run(["reconstruct", str(tmp_path / "none"), "--out", str(tmp_path / "out"), "--effects", "dust"]) == 2
    assert "there is no effect 'dust'" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_without_it_nobody_lists_it():
    assert "dust" not in effects_help() and registry.effect_named("dust") is None
    with pytest.raises(DgsError):
        parse_effects("dust")


def test_the_report_has_words_for_it(with_toy):
    assert "Dust on the lens, undone on the photos before the training." in simulated(reported("dust", True))
    assert "Dust on the lens" in not_simulated(reported("dust", False))
    assert "Dust on the lens" not in not_simulated(reported("dust", True))


def test_a_report_of_an_effect_without_words_is_written_all_the_same(monkeypatch):
    assert any("'gone'" in line for line in simulated(reported("gone", True)))
    bare = EffectSpec("bare", "None.", EffectWords("Bare"), toy.inspect)
    monkeypatch.setattr(registry, "EFFECTS", (*registry.EFFECTS, bare))
    assert any("'bare'" in line for line in simulated(reported("bare", True)))


def test_the_panel_offers_it(with_toy, monkeypatch):
    items = {item[0]: item for item in effect_items()}
    assert items["dust"][1:3] == ("Dust", "Grains on the lens that take a share of all light")
    assert [items[name][4] for name in ("none", "auto", "all")] == [0, 1, 2]
    numbers = {name: item[4] for name, item in items.items()}
    assert len(set(numbers.values())) == len(items) and all(0 <= n < 2**31 for n in numbers.values())
    monkeypatch.setattr(registry, "EFFECTS", (toy.SPEC, *registry.EFFECTS[:-1]))
    assert {item[0]: item[4] for item in effect_items()} == numbers  # saved files keep their choice


def test_inspect_measures_it(with_toy, photos):
    found = {e.name: e for e in inspect_photos(photos, Silent(), ["dust", "saturation"])}
    assert list(found) == ["saturation", "dust"] and found["dust"].needed
    assert any(line.startswith("dust") and "YES" in line for line in table(list(found.values())))
    assert proposed(found.values()) == ["dust"]


def test_a_run_undoes_it(with_toy, photos):
    views = undistorted_views(list(photos.photos), photos.cameras)
    settings = TrainingSettings(steps=5, threads=1)
    chosen = choose_effects("dust", photos.photos, photos.cameras, views, Medium(), TrialTerms(settings), Silent())
    assert chosen.formation.names == ("dust",) and chosen.decisions[-1].parameters["loss"] > 0
    before, after = views[0].planes(), chosen.corrected(views)[0].planes()
    assert np.median(after[before > 0.1] / before[before > 0.1]) > 1.01


def test_the_tradeoff_study_weighs_it(with_toy):
    assert [knob.label for knob in _all() if knob.effects == "dust"] == ["with dust"]


def test_its_gradient_is_autograd_s():
    light = torch.rand(3, 5, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()
    dust, shot = toy.Dust(torch.tensor(0.2, dtype=torch.float64, requires_grad=True)), Shot("a", 5, 6)
    dust.forward(light, shot).square().sum().backward()
    upstream = 2.0 * dust.forward(light, shot).detach()
    with torch.no_grad():
        assert torch.allclose(dust.gradient(upstream, light, shot), light.grad)
    assert torch.allclose(dust.gradients["loss"], dust.parameters["loss"].grad)


def test_every_effect_that_can_be_switched_has_its_words():
    labels = [spec.words.label for spec in registry.all_effects()]
    assert len(set(labels)) == len(labels) and all(labels)
    for spec in registry.all_effects():
        assert len(spec.physics) > 40 and spec.physics.endswith("."), spec.name
        if spec.switch is not None:
            assert spec.words.tooltip and not spec.words.tooltip.endswith("."), spec.name
            assert spec.words.simulated.endswith("."), spec.name
            assert not spec.words.missing.endswith("."), spec.name
            assert spec.name in spec.switch.speakers
    ranks = [switch.trial_rank for switch in registry.switches().values()]
    assert sorted(ranks) == list(range(1, len(ranks) + 1))


def test_an_effect_is_simulated_or_masked():
    with pytest.raises(ValueError, match="either"):
        Switch(speakers=("x",), trial_rank=1)
    with pytest.raises(ValueError, match="either"):
        Switch(speakers=("x",), trial_rank=1, simulation=toy.Dust)


def test_the_page_on_extending_shows_this_very_effect():
    root = Path(dgs.__path__[0])
    page = (root / "docs/extending.md").read_text("utf-8").split("+++ b/core/effects/dust.py\n")[1].split("--- ")[0]
    shown = {line[1:] for line in page.splitlines()}
    source = (root / "tests/core/effects/toy.py").read_text("utf-8").split("\n", 1)[1]
    used = source.replace("from dgs.core.effects.spec", "from .spec").replace("from dgs.core.", "from ..")
    assert set(used.splitlines()) <= shown
