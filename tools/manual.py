"""The manual that goes into the Blender extension: pages of docs/ as HTML, with their pictures."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, StrictUndefined
from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
#: Where it lies, beside what Blender loads; `dgs_addon/manual.py` opens it there.
MANUAL = ROOT / "manual"
#: Pages of docs/ for people who use Blender, and their names in the list at the side.
PAGES = {
    "blender": "In Blender",
    "install": "Installation",
    "usage": "Command line",
    "effects": "Effects",
    "twin": "Later photos",
    "measure": "Measuring",
    "report": "The report",
    "laboratory": "The laboratory",
    "glossary": "Glossary",
}


def main() -> int:
    """Writes all pages and the pictures that they show anew."""
    shutil.rmtree(MANUAL, ignore_errors=True)
    MANUAL.mkdir()
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string((Path(__file__).parent / "manual.html.j2").read_text("utf-8"))
    for page, name in PAGES.items():
        body, pictures = rendered((DOCS / f"{page}.md").read_text("utf-8"))
        (MANUAL / f"{page}.html").write_text(template.render(name=name, body=body, pages=PAGES, here=page), "utf-8")
        for picture in pictures:
            (MANUAL / picture).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(DOCS / picture, MANUAL / picture)
    print(f"Wrote {len(PAGES)} pages of the manual")
    return 0


def rendered(text: str) -> tuple[str, list[str]]:
    """Markdown as HTML, and the pictures in it, relative to docs/. Links to pages that are not here become words.

    Headings, and steps of a list that begin with a bold word, can be linked to (`slug`).
    """
    reader = MarkdownIt("commonmark", {"html": True}).enable("table")
    tokens = reader.parse(text)
    _name_places(tokens)
    pictures: list[str] = []
    for token in tokens:
        if token.children is not None:
            token.children = _within(token.children, pictures)
    return reader.renderer.render(tokens, reader.options, {}), pictures


def slug(words: str) -> str:
    """What a heading is linked by, as GitHub makes it: lower case, '-' for spaces, no other marks."""
    return re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")


def _name_places(tokens: Sequence[Token]) -> None:
    for place, token in enumerate(tokens):
        if token.type == "heading_open":
            token.attrSet("id", slug(tokens[place + 1].content.replace("`", "")))
        elif token.type == "list_item_open" and token.info:  # numbered: a step
            bold = re.match(r"\*\*(\w+)\.\*\*", tokens[place + 2].content)
            if bold:
                token.attrSet("id", slug(bold[1]))


def _within(children: Sequence[Token], pictures: list[str]) -> list[Token]:
    """A line's tokens with links that lead somewhere, and its pictures noted."""
    kept: list[Token] = []
    open_links: list[bool] = []
    for token in children:
        if token.type == "link_open":
            address = _address(str(token.attrGet("href")))
            open_links.append(address is not None)
            if address is None:
                continue
            token.attrSet("href", address)
        elif token.type == "link_close" and not open_links.pop():
            continue
        elif token.type == "image":
            pictures.append(str(token.attrGet("src")))
        kept.append(token)
    return kept


def _address(link: str) -> str | None:
    """A link of docs/ as one of the manual; None where its page is not there."""
    if "://" in link or link.startswith("#"):
        return link
    page, mark, place = link.partition("#")
    name = page.removeprefix("../docs/").removesuffix(".md")
    return f"{name}.html{mark}{place}" if name in PAGES else None


if __name__ == "__main__":
    raise SystemExit(main())
