"""The stage 'effects': what is simulated besides the blur, and the views as the twin is fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import DgsError
from ..imaging.medium import Medium
from ..imaging.psf import PointSpread
from ..photos.load import Photo
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..views import View
from .effects.ablation import TrialTerms
from .effects.choose import Chosen, choose_effects
from .fitted import SplitViews


@dataclass(frozen=True)
class SimulatedEffects:
    """What is simulated.

    Attributes:
        chosen: what was decided about each effect, and the chain of those that are on.
        medium: that the photos were taken through.
        fitted, heldout: the views without what lens and sensor did to them.
        sigma: px, of the blur at the scene's middle depth, where an effect took the place of the medium's.
    """

    chosen: Chosen
    medium: Medium
    fitted: list[View]
    heldout: list[View]
    sigma: float = 0.0

    @property
    def typical(self) -> Medium:
        """What blurs at the scene's middle depth: what says how fine a detail one photo holds."""
        return Medium(PointSpread(sigma_x=self.sigma, sigma_y=self.sigma)) if self.sigma else self.medium


def simulate(
    asked: str,
    photos: Sequence[Photo],
    cameras: Reconstruction,
    views: SplitViews,
    medium: Medium,
    terms: TrialTerms,
    progress: Progress,
) -> SimulatedEffects:
    """Decides which effects are simulated, and undoes on the photos what need not be simulated in every step.

    Args:
        asked: as `--effects` takes it; photos: those with a camera.
        terms: what trials are bound to.

    Raises:
        DgsError: an effect was forced on that these photos say nothing about, or free kernels beside a point spread.
        Cancelled: the user asked to stop.
    """
    chosen = choose_effects(asked, photos, cameras, views.fitted, medium, terms, progress)
    if chosen.formation.kernels is not None and medium.blurs:
        raise DgsError(
            "Free kernels stand for all of a photo's blur, so none can be given beside them",
            "Give --psf none with --effects kernels, or leave one of them out",
        )
    chosen.forget_others([view.name for view in views.fitted])
    return SimulatedEffects(chosen, medium, chosen.corrected(views.fitted), chosen.corrected(views.heldout))
