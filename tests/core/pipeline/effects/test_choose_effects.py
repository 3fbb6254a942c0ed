"""Which effects a run simulates: what was asked, what the photos call for, what a trial confirms."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from dgs.benchmarks import effects as validation
from dgs.benchmarks.effect_scenes import Truth, degrade, make_scene
from dgs.core.errors import Cancelled, DgsError
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.medium import Medium
from dgs.core.inspection.evidence import judged
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.photos.undistort import undistorted_views
from dgs.core.pipeline.effects import ablation, choose, found_again
from dgs.core.pipeline.effects.ablation import TrialTerms
from dgs.core.pipeline.effects.choose import _Trials, choose_effects
from dgs.core.pipeline.effects.decision import parse_effects
from dgs.core.pipeline.effects.matched import matched_psnr
from dgs.core.progress import Silent
from dgs.core.training.grid import coarse_view
from dgs.core.training.settings import TrainingSettings

SETTINGS = TrainingSettings(steps=30, max_gaussians=2000, sh_degree=0, threads=1)


class Notes(Silent):
    """Remembers what it hears, and is cancelled when it is asked for the `stop`-th time."""

    def __init__(self, stop: float = np.inf):
        self.heard, self.asked, self.stop = [], 0, stop

    def note(self, text):
        self.heard.append(text)

    def cancelled(self):
        self.asked += 1
        return self.asked >= self.stop


@pytest.fixture(scope="module")
def scene():
    return make_scene(3, width=192, height=128, views=12, finer=2)


@pytest.fixture(scope="module")
def dim(scene):
    """Photos whose exposure and corners differ."""
    return validation.photo_set(scene, degrade(scene, Truth(exposure=0.2, vignetting=0.3), seed=1))


def chosen(asked, photos):
    views = undistorted_views(list(photos.photos), photos.cameras)
    return choose_effects(asked, photos.photos, photos.cameras, views, Medium(), TrialTerms(SETTINGS), Silent()), views


def test_what_can_be_asked_for():
    assert parse_effects("auto") == ("auto", ()) and parse_effects("none") == ("none", ())
    assert parse_effects("haze, exposure") == ("named", ("haze", "exposure"))
    assert parse_effects("auto,haze,-exposure") == ("auto", ("haze", "-exposure"))
    for text in ("", "fog", "none,haze", "auto,fog"):
        with pytest.raises(DgsError) as caught:
            parse_effects(text)
        assert "vignetting" in caught.value.way_out


def test_none_looks_at_nothing_and_changes_nothing(dim):
    none, views = chosen("none", dim)
    assert not none.formation and none.plain() == []
    assert all(a is b for a, b in zip(none.corrected(views), views, strict=True))


def test_forced_effects_undo_what_was_done(dim, scene):
    on, views = chosen("exposure,vignetting", dim)
    assert on.formation.names == ("vignetting", "exposure")
    clean = degrade(scene, Truth(), seed=1)
    before, after = [], []
    for view, fixed, truth in zip(views, on.corrected(views), clean, strict=True):
        assert fixed.photo.dtype == np.uint16 and fixed.levels == 255
        known = np.ones(truth.shape[:2], bool) if fixed.mask is None else fixed.mask
        planes = truth.transpose(2, 0, 1) / 255.0
        before.append(matched_psnr(view.planes(), planes, known))
        after.append(np.mean((fixed.planes() - planes)[:, known]))
    # One common factor is left (the gauge); the photos agree with one another again.
    assert np.std(after) < 0.012, after
    lines = {d.name: d for d in on.decisions}
    assert lines["exposure"].on and lines["exposure"].parameters and not lines["haze"].on
    assert lines["vignetting"].parameters["strength"][0] == pytest.approx(0.3, abs=0.05)


def test_auto_tries_only_what_the_photos_call_for(dim, monkeypatch):
    tried = []

    def scores(self, arm, medium, pair):
        formation = arm.formation
        tried.append(formation.names)
        n = 6
        return np.full(n, 30.0 + 0.5 * ("exposure" in formation.names)) + 0.01 * np.arange(n) * len(formation.names)

    monkeypatch.setattr(ablation.Ablation, "_scores", scores)
    auto, _ = chosen("auto", dim)
    lines = {d["name"]: d for d in auto.plain()}
    assert lines["exposure"]["on"] and lines["exposure"]["gain_db"] > 0.4 and "confirmed" in lines["exposure"]["why"]
    assert not any("haze" in names for names in tried) and lines["haze"]["why"] == "not needed"
    assert lines["haze"]["evidence"]["estimate"]["value"] is not None
    assert {"blur", "defocus", "noise", "view_dependence"} <= set(lines)  # seen, and said to be not needed
    assert auto.formation.names[-1] == "exposure"
    off, _ = chosen("auto,-exposure", dim)
    assert {d.name: d.why for d in off.decisions}["exposure"] == "forced off"


def test_a_gain_must_stand_out_of_chance():
    assert ablation.Comparison(np.array([0.2, 0.3, 0.25, 0.22])).confirms
    assert not ablation.Comparison(np.array([0.2, -0.3, 0.5, -0.1])).confirms
    assert not ablation.Comparison(np.array([-0.2, -0.21, -0.22])).confirms
    assert ablation.Comparison(np.arange(2)).needed > ablation.Comparison(np.arange(8)).needed > 2.0


@pytest.mark.parametrize(
    ("gains", "least", "pairs", "confirms"),
    [
        ([3.0, 3.2, 2.9, 3.1, 3.0, 3.1], 0.3, 1, True),  # far more than chance, and than is asked
        ([0.0, 0.02, -0.02, 0.01, -0.01, 0.0], 0.3, 1, False),  # out of reach of what is asked
        ([0.4, 0.42, 0.38, 0.41, 0.39, 0.4], 0.3, 2, True),  # no more than confirms: both pairs are asked
        ([0.5, -0.4, 0.6, -0.5, 0.4, -0.3], 0.0, 2, False),  # anything yet
        ([3.0, 3.2, 2.9], 0.3, 2, True),  # too few photos to say
    ],
)
def test_a_trial_ends_where_its_first_pair_has_settled_it(dim, monkeypatch, gains, least, pairs, confirms):
    asked = []

    def scores(self, arm, medium, pair):
        asked.append((pair, arm.formation.names))
        return 30.0 + (np.array(gains) if arm.formation.names else np.zeros(len(gains)))

    monkeypatch.setattr(ablation.Ablation, "_scores", scores)
    trial = ablation.Ablation(
        undistorted_views(list(dim.photos), dim.cameras), dim.cameras.points, Medium(), TrialTerms(SETTINGS)
    )
    exposure = chosen("exposure", dim)[0].formation
    found = trial._compare(ablation.Arm(), ablation.Arm(exposure), through=False, least=least)
    assert [pair for pair, names in asked if not names] == list(range(pairs))
    assert found.confirms is confirms and len(found.differences) == pairs * len(gains)


def test_where_hardly_any_photo_learns_a_path_no_plain_twin_is_trained(dim, monkeypatch):
    asked = []

    def scores(self, arm, medium, pair):
        asked.append(pair)
        self._lengths.extend([0.5] * 9 + [2.0])
        return np.full(6, 30.0)

    monkeypatch.setattr(ablation.Ablation, "_scores", scores)
    trial = ablation.Ablation(
        undistorted_views(list(dim.photos), dim.cameras), dim.cameras.points, Medium(), TrialTerms(SETTINGS)
    )
    found = trial._compare_paths(ablation.Arm(), ablation.Arm())
    assert asked == [0] and not found.confirms and "finds paths in 10% of the photos" in found.seen


_CLEAR, _NEAR, _VARIED, _DOUBTFUL, _NOTHING = (
    np.array(gains) for gains in ([2.0, 2.1] * 3, [0.4, 0.42] * 3, [0.9, 0.3] * 3, [0.5, 0.0] * 3, [0.11, 0.09] * 3)
)
_TRIALS = ((200, 6000), (600, 18000))


@pytest.mark.parametrize(
    ("gains", "confirms", "pairs"),
    [
        ((_CLEAR,), True, (1,)),  # clear at once
        ((-_NOTHING,), False, (1,)),  # lost beyond chance
        ((_NOTHING, _CLEAR), True, (1, 1)),  # that nothing is gained short ones cannot say
        ((_NOTHING, _NOTHING), False, (1, 1)),  # long ones can
        ((_NEAR, _NOTHING), False, (2, 1)),  # what just confirms is asked again
        ((_NEAR, _NEAR), True, (2, 1)),  # long ones may just confirm, and end where that is sure
        ((_NEAR, _VARIED), True, (2, 2)),  # one pair of them leaves it to chance
        ((_NEAR, _NEAR - 0.08), False, (2, 1)),  # that asks for more than the gain of short ones
        ((_DOUBTFUL, _CLEAR), True, (2, 1)),  # in doubt, and cleared up
        ((_DOUBTFUL, -_NOTHING), False, (2, 1)),
    ],
)
def test_what_short_trainings_do_not_settle_longer_ones_do(dim, monkeypatch, gains, confirms, pairs):
    trials, notes = [], Notes()

    def scores(self, arm, medium, pair):
        if not arm.formation.names:
            return np.full(6, 30.0)
        trials.append((self.settings.steps, self.settings.max_gaussians))
        return 30.0 + gains[_TRIALS.index(trials[-1])]

    monkeypatch.setattr(ablation.Ablation, "_scores", scores)
    views = undistorted_views(list(dim.photos), dim.cameras)
    trial = ablation.Ablation(
        views, dim.cameras.points, Medium(), TrialTerms(TrainingSettings.preset("balanced")), notes
    )
    trial._cut(ablation.SETTINGS.path_steps, ablation.SETTINGS.path_gaussians)
    monkeypatch.setattr(ablation.Ablation, "_against_even_blur", lambda self, without, with_it, found: found)
    monkeypatch.setattr(ablation.Ablation, "_against_still_photos", lambda self, with_it, found: found)
    with_it = ablation.Arm(Formation([straight_paths({view.name: (0.01, 0.0) for view in views}, 1)]))
    found = trial._compare_paths(ablation.Arm(), with_it)
    assert found.confirms is confirms
    assert trials == [which for which, count in zip(_TRIALS, pairs, strict=False) for _ in range(count)]
    assert sum("do not settle" in note for note in notes.heard) == len(pairs) - 1


@pytest.mark.parametrize("certain", [True, False])
def test_what_spectra_show_beyond_doubt_longer_trials_need_not_confirm(dim, monkeypatch, certain):
    """Nor do they ask whether a path of each photo that judges explains as much: photos moved, that is seen."""
    trials = []

    def scores(self, arm, medium, pair):
        trials.append((self.settings.steps, arm.still))
        return 30.0 + (_DOUBTFUL if arm.formation.names else 0.0 * _DOUBTFUL)

    monkeypatch.setattr(ablation.Ablation, "_scores", scores)
    views = undistorted_views(list(dim.photos), dim.cameras)
    trial = ablation.Ablation(views, dim.cameras.points, Medium(), TrialTerms(TrainingSettings.preset("balanced")))
    with_it = ablation.Arm(Formation([straight_paths({view.name: (0.01, 0.0) for view in views}, 1)]))
    found = trial.compare(ablation.Arm(), with_it, certain)
    assert not found.contradicts and not found.confirms
    assert ({steps for steps, _ in trials} == {ablation.SETTINGS.path_steps}) is certain
    assert not any(still for _, still in trials)


@pytest.mark.parametrize("certain", [True, False])
def test_a_round_blur_that_photos_share_is_no_rival_of_what_spectra_show(dim, monkeypatch, certain):
    """They show what photos do not share."""

    def scores(self, arm, medium, pair):
        self._lengths = [6.0] * 6
        return 30.0 + (_CLEAR if arm.formation.names or medium.blurs else 0.0 * _CLEAR)

    monkeypatch.setattr(ablation.Ablation, "_scores", scores)
    views = undistorted_views(list(dim.photos), dim.cameras)
    trial = ablation.Ablation(views, dim.cameras.points, Medium(), TrialTerms(SETTINGS))
    with_it = ablation.Arm(Formation([straight_paths({view.name: (0.01, 0.0) for view in views}, 1)]))
    found = trial.compare(ablation.Arm(), with_it, certain)
    assert found.confirms is certain and ("round blur" in found.seen) is not certain


@pytest.mark.parametrize(("still", "confirmed"), [(0.0, True), (0.2, True), (0.6, False)])
def test_longer_trials_ask_whether_photos_that_judge_need_more_than_a_path_of_their_own(
    dim, monkeypatch, still, confirmed
):
    """Paths explain 1 dB more than none: `still` stands for them from a third on, unless chance is ruled out."""
    spread = np.array([1.6, -1.2, 1.3, -0.9, 1.0, -1.8])

    def scores(self, arm, medium, pair):
        if not arm.formation.names:
            return np.full(6, 30.0)
        if self.settings.steps <= ablation.SETTINGS.path_steps:
            return 30.1 + 0.02 * spread
        return 31.0 + 0.02 * spread if not arm.still else 30.0 + still + 0.5 * spread

    monkeypatch.setattr(ablation.Ablation, "_scores", scores)
    monkeypatch.setattr(ablation.Ablation, "_against_even_blur", lambda self, without, with_it, found: found)
    views = undistorted_views(list(dim.photos), dim.cameras)
    trial = ablation.Ablation(views, dim.cameras.points, Medium(), TrialTerms(TrainingSettings.preset("balanced")))
    trial._cut(ablation.SETTINGS.path_steps, ablation.SETTINGS.path_gaussians)
    moved = ablation.Arm(Formation([straight_paths({view.name: (0.01, 0.0) for view in views}, 1)]))
    found = trial._compare_paths(ablation.Arm(), moved)
    assert found.confirms is confirmed and ("nothing moved" in found.seen) is not confirmed


def _paths(angles):
    """[17, 2] px of each photo, straight."""
    ends = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return {str(i): np.linspace(-3.0, 3.0, 17)[:, None] * end for i, end in enumerate(ends)}


class Case(NamedTuple):
    """Two trainings: what is gained (dB), its spread, seconds left, photos asked for that both were made of."""

    alike: bool = True
    gain: float = 1.0
    spread: float = 0.02
    left: float = np.inf
    fewest: int = 6


@pytest.mark.parametrize(
    ("case", "confirmed", "said"),
    [
        pytest.param(Case(), True, "same paths, 0% as far", id="a second pair is trained for it"),
        pytest.param(Case(alike=False), False, "do not find the same", id="other paths, however much is gained"),
        pytest.param(Case(left=1.0), False, "before a twin of still", id="no time: a rival decides"),
        pytest.param(Case(fewest=7), False, "before a twin of still", id="too few photos: a rival decides"),
        pytest.param(Case(gain=0.2, spread=0.15), False, "", id="too little is gained: not asked"),
        pytest.param(Case(gain=0.5, spread=0.6), False, "", id="as much as chance gains: not asked"),
    ],
)
def test_paths_that_two_trainings_find_are_believed(dim, monkeypatch, case, confirmed, said):
    """However much they gain, and no rival is asked."""
    shape, trained = np.array([1.6, -1.2, 1.3, -0.9, 1.0, -1.8]), []
    angles = [np.random.default_rng(seed).uniform(0.0, 2 * np.pi, len(dim.photos)) for seed in (7, 8)]

    def scores(self, arm, medium, pair):
        if not arm.formation.names:
            return np.full(6, 30.0)
        if self.settings.steps <= ablation.SETTINGS.path_steps:
            return 30.1 + 0.02 * shape
        trained.append((pair, arm.still))
        if not arm.still:
            self._ways[pair] = _paths(angles[0 if case.alike else pair])
            self._slowest = 2.0
        return 30.0 + case.gain + (case.spread if not arm.still else 0.5) * shape

    monkeypatch.setattr(ablation.Ablation, "_scores", scores)
    monkeypatch.setattr(ablation.Ablation, "_against_even_blur", lambda *_: pytest.fail("no rival of such paths"))
    monkeypatch.setattr(found_again, "SETTINGS", replace(found_again.SETTINGS, fewest=case.fewest))
    views = undistorted_views(list(dim.photos), dim.cameras)
    terms = TrialTerms(TrainingSettings.preset("balanced"), lambda: case.left if trained else np.inf)
    trial = ablation.Ablation(views, dim.cameras.points, Medium(), terms)
    trial._cut(ablation.SETTINGS.path_steps, ablation.SETTINGS.path_gaussians)
    moved = ablation.Arm(Formation([straight_paths({view.name: (0.01, 0.0) for view in views}, 1)]))
    found = trial._compare_paths(ablation.Arm(), moved)
    assert found.confirms is confirmed
    assert said in (found.seen or found.beside) and bool(found.beside) is confirmed
    assert any(still for _, still in trained) is ("still" in said)
    assert ((1, False) in trained) is (said != "before a twin of still")


def test_only_photos_that_judge_have_a_path_where_others_stand_still(dim):
    names = [photo.name for photo in dim.photos]
    exposure = choose.built("exposure", dim)
    moved = ablation.Arm(Formation([straight_paths(dict.fromkeys(names, (0.01, 0.0)), 1), exposure]))
    still = replace(moved, still=True).of_pair(names[:2])
    assert list(still.motion.names) == names[:2] and still.names == moved.formation.names
    assert moved.of_pair(names[:2]) is moved.formation
    views = undistorted_views(list(dim.photos), dim.cameras)
    settings = replace(SETTINGS, steps=6, max_gaussians=300)
    trial = ablation.Ablation(views, dim.cameras.points, Medium(), TrialTerms(settings))
    only = replace(moved, formation=Formation([moved.formation.motion]), still=True)
    assert np.isfinite(trial._scores(only, trial.medium, 0)).all() and not trial._lengths and not trial._ways
    trial._scores(replace(only, still=False), trial.medium, 0)
    fitted = {view.name for i, view in enumerate(views) if i not in trial.judged(0)}
    assert set(trial._ways[0]) == fitted and all(way.shape == (17, 2) for way in trial._ways[0].values())


def test_a_trial_ends_in_the_middle_of_its_training_when_the_run_is_cancelled(dim):
    views, impatient = undistorted_views(list(dim.photos), dim.cameras), Notes(stop=5)
    with pytest.raises(Cancelled, match="while effects were tried"):
        ablation.Ablation(views, dim.cameras.points, Medium(), TrialTerms(SETTINGS), impatient).compare(
            ablation.Arm(), ablation.Arm()
        )
    assert impatient.asked == 5


def test_a_trial_is_no_longer_than_the_training(dim):
    views = undistorted_views(list(dim.photos), dim.cameras)
    settings = replace(TrainingSettings.preset("balanced"), steps=150)
    assert ablation.Ablation(views, dim.cameras.points, Medium(), TrialTerms(settings))._on(views, 1)._longer() is None


def test_the_trial_trains_and_judges_for_real(dim):
    """Real trainings, too short to be good: photos that were judged were not fitted, and both arms share them."""
    views = undistorted_views(list(dim.photos), dim.cameras)
    trial = ablation.Ablation(views, dim.cameras.points, Medium(), TrialTerms(SETTINGS))
    assert trial.possible and not set(trial.judged(0)) & set(trial.judged(1))
    result = trial.compare(ablation.Arm(), ablation.Arm())
    assert len(result.differences) == 6 and (result.differences == 0).all() and not result.confirms
    assert not ablation.Ablation(views[:4], dim.cameras.points, Medium(), TrialTerms(SETTINGS)).possible


def test_a_trial_s_price_does_not_grow_with_the_photos(dim):
    views = undistorted_views(list(dim.photos), dim.cameras)
    large = [coarse_view(view, 1) for view in views]
    large = [replace(v, photo=v.photo.repeat(4, axis=0).repeat(4, axis=1), camera=enlarged(v.camera, 4)) for v in large]
    small, wide = (ablation.Ablation(v, dim.cameras.points, Medium(), TrialTerms(SETTINGS)) for v in (views, large))
    heights = [trial._coarse(trial.views[0], Medium()).camera.height for trial in (small, wide)]
    assert max(heights) < 2 * ablation.SETTINGS.side and wide.step == large[0].camera.height // ablation.SETTINGS.side
    assert len(ablation._fewer(small.points).positions) == ablation.SETTINGS.points < len(dim.cameras.points.positions)


def enlarged(camera, s):
    """The camera of a photo with `s` times as many px along each side."""
    return replace(
        camera,
        width=s * camera.width,
        height=s * camera.height,
        fx=s * camera.fx,
        fy=s * camera.fy,
        cx=s * camera.cx,
        cy=s * camera.cy,
    )


def test_trials_stop_when_asked_to(dim):
    class Stopping(Silent):
        at = ""

        def stage(self, name, total=None):
            self.at = name

        def cancelled(self):
            return self.at == "effects"

    views = undistorted_views(list(dim.photos), dim.cameras)
    with pytest.raises(Cancelled):
        choose_effects("auto", dim.photos, dim.cameras, views, Medium(), TrialTerms(SETTINGS), Stopping())


def test_matched_scores_take_the_photo_s_own_gain():
    random = np.random.default_rng(0)
    picture = random.uniform(0.2, 0.7, (3, 40, 40))
    from dgs.core.colour import linear_to_srgb, srgb_to_linear

    darker = linear_to_srgb(0.6 * srgb_to_linear(picture))
    assert matched_psnr(picture, darker) > 60
    noisy = darker + 0.02 * random.standard_normal(darker.shape)
    assert 30 < matched_psnr(picture, noisy) < 40


def test_a_trial_of_motion_sees_paths_and_stays_cheap(dim):
    """Photos are averaged down less than usual, so that a path is still long enough, and cut to their middles."""
    views = undistorted_views(list(dim.photos), dim.cameras)
    large = [replace(v, photo=v.photo.repeat(4, axis=0).repeat(4, axis=1), camera=enlarged(v.camera, 4)) for v in views]
    side = ablation.SETTINGS.path_side
    trial = ablation.Ablation(large, dim.cameras.points, Medium(), TrialTerms(SETTINGS))
    moved = Formation([straight_paths({v.name: (9.0 / v.camera.fx, 0.0) for v in large}, 1)])
    finer = trial._finer(ablation.Arm(moved))
    coarse = finer._coarse(finer.views[0], Medium())
    assert trial.step == 6 and finer.step == 2 and 9.0 / finer.step >= ablation.SETTINGS.path_px
    assert min(coarse.camera.width, coarse.camera.height) == side and coarse.photo.shape[0] == side
    whole, middle = large[0].camera, finer.views[0].camera
    assert whole.cx - middle.cx == (whole.width - middle.width) // 2 and middle.fx == whole.fx
    assert ablation.cropped(views[0], 500) is views[0]


def test_motion_may_be_asked_for_where_no_spectrum_shows_any(dim):
    """A motion that all photos share leaves no trace in their spectra: the training decides how long paths are."""
    found, _ = chosen("motion", dim)
    line = next(d for d in found.decisions if d.name == "motion")
    assert line.on and line.why == "forced on" and found.formation.motion is not None


def path_scores(even, paths):
    """Scores of trainings of which nothing is run: `even` and `paths` dB above none."""

    def scores(self, arm, medium, pair):
        self._lengths = [6.0] * 6
        added = paths if arm.formation.motion is not None else even if medium.blurs else 0.0
        return 30.0 + added + 0.01 * np.arange(6) * (added > 0)

    return scores


@pytest.mark.parametrize(("even", "confirmed"), [(0.0, True), (0.6, True), (0.9, False), (1.4, False)])
def test_paths_must_explain_more_than_a_round_blur_of_all_photos(dim, monkeypatch, even, confirmed):
    monkeypatch.setattr(ablation.Ablation, "_scores", path_scores(even, 0.9))
    views = undistorted_views(list(dim.photos), dim.cameras)
    trial = ablation.Ablation(views, dim.cameras.points, Medium(), TrialTerms(SETTINGS))
    moved = straight_paths({view.name: (0.01, 0.0) for view in views}, 1)
    result = trial.compare(ablation.Arm(), ablation.Arm(Formation([moved])))
    assert result.confirms is confirmed and ("round blur" in result.seen) is not confirmed


def test_paths_stay_where_a_round_blur_explains_next_to_nothing(dim, monkeypatch):
    """Few photos may be too few to tell paths from a round blur; but then this one must explain something."""

    def noisy(even):
        def scores(self, arm, medium, pair):
            self._lengths = [6.0] * 6
            spread = np.array([1.6, -1.2, 1.3, -0.9, 1.0, 1.2])
            paths, rival = 0.5 + 0.02 * spread, (even - 0.5 * spread) * medium.blurs
            return 30.0 + (paths if arm.formation.motion is not None else rival)

        return scores

    views = undistorted_views(list(dim.photos), dim.cameras)
    moved = straight_paths({view.name: (0.01, 0.0) for view in views}, 1)
    for even, confirmed in ((0.0, True), (0.3, False)):
        monkeypatch.setattr(ablation.Ablation, "_scores", noisy(even + 0.25))
        trial = ablation.Ablation(views, dim.cameras.points, Medium(), TrialTerms(SETTINGS))
        result = trial.compare(ablation.Arm(), ablation.Arm(Formation([moved])))
        assert result.confirms is confirmed


@pytest.mark.parametrize(("gain", "on"), [(0.1, True), (-0.5, False)])
def test_motion_that_spectra_show_beyond_doubt_need_only_not_be_contradicted(scene, monkeypatch, gain, on):
    def scores(self, arm, medium, pair):
        self._lengths = [6.0] * 6
        return 30.0 + (gain + 0.1 * np.array([2, -2, 1, -1, 1.5, -1.5])) * (arm.formation.motion is not None)

    monkeypatch.setattr(ablation.Ablation, "_scores", scores)
    shaken = validation.photo_set(scene, degrade(scene, Truth(motion=12.0), seed=1))
    assert shaken.motion is not None and shaken.motion.certain
    found, _ = chosen("auto", shaken)
    line = next(d for d in found.decisions if d.name == "motion")
    assert line.on is on, line.why
    assert ("spectra show it beyond doubt" in line.why) is on


def glass_called(needed=True):
    return judged("glass", 3.0 if needed else 0.0, 0.2, 1.0, "px", "")


def test_blur_alike_in_all_photos_is_tried_first_and_alone(dim, monkeypatch):
    """Where the points show glass, neither paths nor foci are tried: they would be taken for a part of it."""
    source = PhotoSet(list(dim.photos), dim.cameras)
    trials = _Trials.called_for([glass_called()], source)
    assert trials.names[0] == "glass" and not {"motion", "defocus"} & set(trials.names)
    assert "glass" not in _Trials.called_for([glass_called(False)], source).names
    both = _Trials.called_for([glass_called(), judged("motion", 9.0, 0.1, 3.0, "px", "")], source)
    assert "motion" in both.names and "glass" not in both.names
