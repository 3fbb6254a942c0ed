"""The verdict on a twin: does it predict photos that it was not trained on, where not, and what would help.

The error on unseen photos is compared with the error on fitted ones. A twin of the scene has nearly the same on both.
One that only remembers its photos (too few views, wrong depths, shreds before a camera) has a much larger one on
unseen photos, however good the fitted ones look.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..evaluation.view_scores import PARTS, ViewScores
from ..numbers import BY_DEFINITION, number
from ..reconstruction import Reconstruction

Level = Literal["good", "doubtful", "poor", "unknown"]


#: What chose the numbers that no definition gives, and what they were checked on.
_THOUGHT_OF, _LOOKED_AT = "thought of, on no data", "lego, a ball of 12 photos: whether what is said is so"


@dataclass(frozen=True)
class VerdictSettings:
    """When a twin is said to predict unseen photos."""

    doubtful_ratio: float = number(
        2.0, "factor", "squared error on unseen photos over that on fitted ones: 3 dB", BY_DEFINITION
    )
    poor_ratio: float = number(
        4.0, "factor", "the same: 6 dB, twice the error, where a tenth is unexplained as well", BY_DEFINITION
    )
    doubtful_share: float = number(
        0.1, "of a photo's variance", "that stays unexplained: a tenth of what the photos show", _THOUGHT_OF, _LOOKED_AT
    )
    poor_share: float = number(
        0.3, "of a photo's variance", "that stays unexplained: nearly a third", _THOUGHT_OF, _LOOKED_AT
    )
    small_share: float = number(
        0.01,
        "of a photo's variance",
        "unexplained on unseen photos: so little is good whatever the ratio",
        _THOUGHT_OF,
        _LOOKED_AT,
    )
    bad_view: float = number(2.0, "factor", "squared error of a view over the mean: 3 dB below it", BY_DEFINITION)
    named_views: int = number(3, "count", "worst views that are named")
    part_share: float = number(
        1 / 3, "of a view's squared error", "in one of nine parts, from which on it is named", _THOUGHT_OF, _LOOKED_AT
    )
    exposure_gain: float = number(
        1.0, "dB", "that matching each photo's brightness gains, from which on it is said", _THOUGHT_OF, _LOOKED_AT
    )
    wide_angle: float = number(
        15.0,
        "degrees",
        "from an unseen view to the nearest fitted one, as the scene sees them: SIFT matches to 30",
        _THOUGHT_OF,
        _LOOKED_AT,
    )
    still_rising: float = number(
        0.1, "dB", "that the last quarter of the training gained: more time helps", _THOUGHT_OF, _LOOKED_AT
    )


VERDICT = VerdictSettings()

#: How a doubtful twin predicts, and what it is between its photos.
_ROUGHLY = "predicts less well", "less exact than before them"


@dataclass(frozen=True)
class Verdict:
    """What is said of a twin.

    Attributes:
        level: 'good', 'doubtful', 'poor', or 'unknown' where no photo was held out.
        sentence: the verdict in words.
        unseen, fitted: share of the photos' variance that the twin leaves unexplained, mean over views; None if none.
        views: sentences about the worst unseen views.
        help: what would make the twin better, most promising first.
    """

    level: Level
    sentence: str
    unseen: float | None = None
    fitted: float | None = None
    views: tuple[str, ...] = ()
    help: tuple[str, ...] = field(default=())


def verdict(
    unseen: Sequence[ViewScores],
    fitted: Sequence[ViewScores],
    cameras: Reconstruction,
    history: Sequence[Mapping[str, float]],
    settings: VerdictSettings = VERDICT,
) -> Verdict:
    """Judges a twin.

    Args:
        unseen: scores of held-out views against their photos; fitted: of some views that were trained on.
        cameras: of all photos.
        history: of the training, with 'heldout_psnr' (dB) where it was measured.
    """
    judged = [score for score in unseen if score.unexplained is not None]
    known = [score.unexplained for score in fitted if score.unexplained is not None]
    if not judged or not known:
        why = "No photo was held out" if not unseen else "No photo could be scored"
        return Verdict(
            "unknown",
            f"{why}, so nothing says how well the twin predicts photos that it has not seen.",
            help=() if unseen else ("Hold photos out (--holdout-every 8)",),
        )
    share = float(np.mean([_left(score) for score in judged]))
    fitted_share = float(np.mean(known))
    level = _level(share, fitted_share, settings)
    ratio = math.inf if fitted_share == 0.0 else share / fitted_share
    worst = [score for score in judged if _left(score) > settings.bad_view * share]
    if level != "good" and not worst:
        worst = judged
    worst = sorted(worst, key=lambda score: -_left(score))[: settings.named_views]
    return Verdict(
        level,
        _sentence(level, share, fitted_share, ratio),
        round(share, 5),
        round(fitted_share, 5),
        tuple(_view(score, cameras, {s.name for s in judged}, settings) for score in worst),
        () if level == "good" else tuple(_help(judged, worst, cameras, history, fitted_share, settings)),
    )


def _left(score: ViewScores) -> float:
    """Share of a view's variance that is left unexplained."""
    return score.unexplained or 0.0


def _gain_of_exposure(score: ViewScores) -> float:
    """What a view's PSNR gains (dB) where its photo's own brightness is matched."""
    scores = score.degraded or {}
    if scores.get("psnr_halves") is not None:  # it was learned
        return 0.0
    matched, plain = scores.get("psnr_matched"), scores.get("psnr")
    return 0.0 if matched is None or plain is None else matched - plain


def _level(share: float, fitted: float, settings: VerdictSettings) -> Level:
    if share <= settings.small_share:
        return "good"
    much = share > settings.doubtful_share
    if share > settings.poor_share or (much and share > settings.poor_ratio * fitted):
        return "poor"
    return "doubtful" if much or share > settings.doubtful_ratio * fitted else "good"


def _sentence(level: Level, share: float, fitted: float, ratio: float) -> str:
    explained = f"{_percent(1 - share)} of what unseen photos show, {_percent(1 - fitted)} of what fitted ones show"
    if level == "good":
        return f"The twin predicts photos that it has not seen: it explains {explained}."
    if ratio > VERDICT.doubtful_ratio:
        how, between = ("hardly predicts", "not to be trusted") if level == "poor" else _ROUGHLY
        return (
            f"The twin {how} photos that it has not seen: it explains {explained}. Between its photos it is {between}."
        )
    return f"The twin explains its own photos only in part, and unseen ones alike: {explained}."


def _percent(share: float) -> str:
    """With as many digits as tell it from all: 99.93 %."""
    digits = 0 if share < 0.9 else 1 if share < 0.99 else 2
    return f"{max(0.0, 100.0 * share):.{digits}f} %"


def _view(score: ViewScores, cameras: Reconstruction, held: set[str], settings: VerdictSettings) -> str:
    """Where a view is bad, and how far it is from the fitted ones."""
    found = f"{score.name}: {_percent(1 - _left(score))} explained"
    if score.parts is not None:
        parts = np.asarray(score.parts)
        if parts.sum() > 0 and parts.max() / parts.sum() > settings.part_share:
            found += f", most of the error {PARTS[int(parts.argmax())]}"
    angle, nearest = _nearest(score.name, cameras, held)
    return found + (f", {angle:.0f}° from the nearest fitted photo ({nearest[0]})" if nearest else "")


def _nearest(name: str, cameras: Reconstruction, held: set[str]) -> tuple[float, list[str]]:
    """Degrees between a view and the nearest fitted one as the scene's middle sees them, and the two nearest names."""
    others = [other for other in cameras.poses if other not in held]
    if name not in cameras.poses or not others or not len(cameras.points.positions):
        return 0.0, []
    middle = np.median(cameras.points.positions, axis=0)
    own = cameras.poses[name].centre - middle
    rays = np.array([cameras.poses[other].centre for other in others]) - middle
    cosines = rays @ own / np.maximum(np.linalg.norm(rays, axis=1) * np.linalg.norm(own), 1e-300)
    order = np.argsort(-cosines, kind="stable")
    return float(np.degrees(np.arccos(np.clip(cosines[order[0]], -1, 1)))), [others[i] for i in order[:2]]


def _since_restored(history: Sequence[Mapping[str, float]]) -> Sequence[Mapping[str, float]]:
    """The rows since new Gaussians were fitted to restored photos, which rise from low by themselves; all without."""
    restored = [index for index, row in enumerate(history) if row.get("restored")]
    return history[restored[-1] + 1 :] if restored else history


def _help(
    judged: Sequence[ViewScores],
    worst: Sequence[ViewScores],
    cameras: Reconstruction,
    history: Sequence[Mapping[str, float]],
    fitted: float,
    settings: VerdictSettings,
) -> list[str]:
    advice = []
    if cameras.figures.doubted > 0:
        advice.append(
            f"The cameras may be wrong: {_percent(cameras.figures.doubted)} of the pairs of photos contradict them, as"
            " where two places look alike. Take photos nearer to one another, or give cameras (--cameras)"
        )
    held = {score.name for score in judged}
    for score in worst:
        angle, nearest = _nearest(score.name, cameras, held)
        if angle > settings.wide_angle:
            between = " and ".join(nearest)
            advice.append(f"Take photos between {between}: they look from {angle:.0f}° apart or more")
            break
    gain = float(np.mean([_gain_of_exposure(score) for score in judged]))
    if gain > settings.exposure_gain:
        differ = f"The photos differ in exposure ({gain:.1f} dB)"
        advice.append(f"{differ}: lock it while photographing, or use --effects auto")
    rows = [row["heldout_psnr"] for row in _since_restored(history) if "heldout_psnr" in row]
    if len(rows) > 3 and rows[-1] - rows[-1 - len(rows) // 4] > settings.still_rising:
        advice.append("The training was still getting better: give it more time (--preset best, --time-limit)")
    if fitted > settings.doubtful_share:
        advice.append(
            "Mask what moved between the photos (--masks), and check the cameras and the blur that were given"
        )
    if not advice:
        advice.append("Take more photos of the places that are named, from directions between the present ones")
    return advice
