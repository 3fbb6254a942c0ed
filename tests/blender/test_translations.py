"""The panel speaks the user's language: every text of panels and operators has a German one."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs import operators, panels  # noqa: E402
from dgs.dgs_addon.job.properties import DGS_PG_settings  # noqa: E402
from dgs.dgs_addon.job.state import STAGES  # noqa: E402
from dgs.dgs_addon.translations import messages, table  # noqa: E402

ROOT = Path(dgs.__path__[0])
GERMAN = table("de_DE")
#: Functions whose text arguments are shown.
SHOWN = {"sentence", "figures", "folded", "iface_", "rpt_", "label", "operator", "prop", "poll_message_set"}
#: Names and units that are the same in every language.
SAME = {"", "COLMAP", "Descatter", "CPU", "PLY", "SPZ", "px", "glTF", "{value:.2f} dB", "{stage}, {time} left"}


@pytest.fixture(autouse=True)
def add_on() -> Iterator[None]:
    dgs.register()
    yield
    dgs.unregister()


def literals(node: ast.expr) -> Iterator[str]:
    """The texts that an argument may be."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.IfExp):
        yield from literals(node.body)
        yield from literals(node.orelse)


def texts(path: Path) -> Iterator[str]:
    """Texts that a file shows: in calls, and as reasons why a button cannot be pressed."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if name in SHOWN:
                arguments = [k.value for k in node.keywords if k.arg == "text"]
                if name in ("sentence", "figures", "folded", "iface_", "rpt_", "poll_message_set"):
                    arguments += node.args
                for argument in arguments:
                    yield from literals(argument)
        elif isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in ("reason", "text"):
            yield from literals(node.value)


def shown() -> set[str]:
    files = [*(ROOT / "panels").glob("*.py"), *(ROOT / "operators").glob("*.py")]
    files.append(ROOT / "dgs_addon" / "photos.py")
    found = {text for path in files for text in texts(path) if " " in text or text[:1].isupper()}
    found |= {kind.bl_label for kind in (*panels.CLASSES, *operators.CLASSES)}
    found |= {kind.__doc__ for kind in operators.CLASSES if issubclass(kind, bpy.types.Operator)}
    for prop in DGS_PG_settings.bl_rna.properties:
        if prop.identifier not in ("rna_type", "name"):
            found |= {prop.name, prop.description}
            found |= {text for item in getattr(prop, "enum_items", ()) for text in (item.name, item.description)}
    found |= set(STAGES.values())
    return {text for text in found if not re.fullmatch(r"[A-Z_0-9]+", text)} - SAME


def test_every_text_is_translated() -> None:
    wanted = shown()
    assert len(wanted) > 150
    assert sorted(wanted - GERMAN.keys()) == []


def test_places_for_figures_are_the_same_in_both_languages() -> None:
    for english, german in GERMAN.items():
        assert sorted(re.findall(r"{.*?}", english)) == sorted(re.findall(r"{.*?}", german)), english
        assert not english.endswith(".") or german.endswith((".", "…")), english


def test_blender_gets_each_text_for_labels_and_for_buttons() -> None:
    german = messages()["de_DE"]
    assert german[("Operator", "Optimize")] == german[("*", "Optimize")] == "Optimieren"
