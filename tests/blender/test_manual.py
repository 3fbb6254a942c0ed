"""The manual: every button and field leads to a place that is there, as Blender itself looks it up."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from bl_operators.wm import WM_OT_doc_view_manual  # noqa: E402
from dgs import operators  # noqa: E402
from dgs.dgs_addon import manual  # noqa: E402
from dgs.dgs_addon.job.properties import DGS_PG_settings  # noqa: E402
from dgs.tests.blender.test_extension import package  # noqa: F401, E402

ROOT = Path(dgs.__path__[0])


@pytest.fixture(autouse=True)
def add_on() -> Iterator[None]:
    dgs.register()
    yield
    dgs.unregister()


def looked_up(name: str) -> str:
    """What F1 opens."""
    return WM_OT_doc_view_manual._lookup_rna_url(name, verbose=False) or ""


def test_f1_on_every_button_and_field_leads_to_the_manual() -> None:
    buttons = [kind.bl_idname for kind in operators.CLASSES if issubclass(kind, bpy.types.Operator)]
    fields = [prop.identifier for prop in DGS_PG_settings.bl_rna.properties if not prop.is_hidden]
    assert len(buttons) > 60 and len(fields) > 30
    for name in (*(f"bpy.ops.{button}" for button in buttons), *(f"bpy.types.DGS_PG_settings.{f}" for f in fields)):
        assert looked_up(name).startswith("file://"), name
    assert looked_up("bpy.types.DGS_AP_preferences.python").endswith("#the-engine")
    assert looked_up("bpy.types.DGS_PG_settings.sigma").endswith("#the-blur---psf")
    assert looked_up("bpy.ops.dgs.select_floaters").endswith("#cleaning-up-a-twin")


def test_blenders_own_manual_is_as_before_and_ours_goes_with_the_add_on() -> None:
    assert "docs.blender.org" in looked_up("bpy.types.object.location") or looked_up("bpy.types.object.location") == ""
    dgs.unregister()
    assert looked_up("bpy.ops.dgs.optimize") == ""
    dgs.register()


def test_every_place_has_a_heading_in_the_zip(package: Path) -> None:  # noqa: F811
    archive = zipfile.ZipFile(package)
    for place in dict(manual.PLACES).values():
        page, _, heading = place.partition("#")
        assert f'id="{heading}"' in archive.read(f"manual/{page}.html").decode(), place


def test_pages_hang_together(package: Path) -> None:  # noqa: F811
    archive = zipfile.ZipFile(package)
    names = set(archive.namelist())
    pages = [name for name in names if name.startswith("manual/") and name.endswith(".html")]
    assert len(pages) > 8
    for name in pages:
        page = archive.read(name).decode()
        for link in re.findall(r'(?:href|src)="([^"]+)"', page):
            if "://" in link:
                continue
            file, _, heading = link.partition("#")
            target = f"manual/{file}" if file else name
            assert target in names, f"{name}: {link}"
            assert not heading or f'id="{heading}"' in archive.read(target).decode(), f"{name}: {link}"
        assert "](" not in re.sub(r"<(code|pre)>.*?</\1>", "", page, flags=re.DOTALL), name  # no Markdown left


def test_a_clone_without_pages_opens_the_texts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(manual, "_PAGES", tmp_path)
    opened = urlparse(manual.address("blender#jobs"))
    assert Path(unquote(opened.path)) == ROOT / "docs" / "blender.md" and opened.fragment == "jobs"
    assert bpy.ops.dgs.open_manual() == {"FINISHED"}
