"""The stage 'report': what the other stages found, as report.json and report.html."""

from __future__ import annotations

from typing import Any

from ..report.page import write_page
from ..report.pictures import ViewPictures
from ..report.summary import CameraFacts, MediumFacts, PhotoFacts, RunFacts, summary
from ..twin.folder import TwinFolder
from .cameras import FoundCameras
from .medium import FoundMedium
from .photos import LoadedPhotos
from .scores import resolvable_period
from .simulated import SimulatedEffects


def photo_facts(loaded: LoadedPhotos) -> PhotoFacts:
    """For report.json."""
    return PhotoFacts(loaded.source, loaded.photos, loaded.held, loaded.every)


def camera_facts(found: FoundCameras) -> CameraFacts:
    """For report.json."""
    return CameraFacts(found.reconstruction, found.source, found.file, found.refined)


def medium_facts(found: FoundMedium, effects: SimulatedEffects) -> MediumFacts:
    """For report.json."""
    spreads = found.spreads
    own = {name: "none" if psf is None else psf.source for name, psf in spreads.own.items()}
    return MediumFacts(spreads.source, own, effects.medium, resolvable_period(effects.typical))


def write_report(facts: RunFacts, pictures: list[ViewPictures], folder: TwinFolder) -> dict[str, Any]:
    """Writes report.json and report.html; the content of the first.

    Raises:
        OutputError: they cannot be written.
    """
    report = summary(facts)
    folder.save_report(report)
    write_page(folder.report_page, report, pictures, facts.medium.medium.psf, facts.cameras.reconstruction.cameras())
    return report
