"""Move code out of the built pages, so that they work under a policy that forbids inline code.

The service serves the site under a content security policy of `'self'`. The theme writes scripts, styles and
style attributes into each page and images into its style sheet; they become files under `_static/external/`.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

if TYPE_CHECKING:
    from sphinx.application import Sphinx

__all__ = ["externalise", "inline_code", "setup"]

_SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
_STYLE = re.compile(r"<style[^>]*>(.*?)</style>", re.DOTALL)
_ATTRIBUTE = re.compile(r'(<[a-zA-Z][^<>]*?)\sstyle="([^"]*)"')
_IMAGE = re.compile(r"""url\((["'])data:image/svg\+xml;charset=utf-8,(.*?)\1\)""")
_HANDLER = re.compile(r"<[a-zA-Z][^<>]*\son[a-z]+=")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("build-finished", _on_finished)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _on_finished(app: Sphinx, exception: Exception | None) -> None:
    if exception is None and app.builder.format == "html":
        externalise(Path(app.outdir))


def externalise(site: Path) -> None:
    """Move inline code of all pages and style sheets of a built site to files.

    Raises:
        ValueError: a page keeps code that cannot be moved.
    """
    folder = site / "_static" / "external"
    folder.mkdir(parents=True, exist_ok=True)
    for sheet in site.rglob("*.css"):
        sheet.write_text(_without_images(sheet, folder), encoding="utf-8")
    for page in site.rglob("*.html"):
        page.write_text(_external(page, folder), encoding="utf-8")
    left = [
        f"{page}: {code}" for page in site.rglob("*.html") for code in inline_code(page.read_text("utf-8"))
    ]
    if left:
        raise ValueError("inline code is left in the site:\n" + "\n".join(left))


def inline_code(html: str) -> Iterator[str]:
    """Return what a policy without inline code would block in a page."""
    for pattern in (_SCRIPT, _STYLE, _ATTRIBUTE, _HANDLER):
        yield from (found[0] for found in pattern.finditer(html))


def _without_images(sheet: Path, folder: Path) -> str:
    def image(found: re.Match[str]) -> str:
        return f"url({_relative(_write(folder, found[2], 'svg'), sheet)})"

    return _IMAGE.sub(image, sheet.read_text(encoding="utf-8"))


def _external(page: Path, folder: Path) -> str:
    html, rules = page.read_text(encoding="utf-8"), {}

    def attribute(found: re.Match[str]) -> str:
        name = hashlib.sha256(found[2].encode()).hexdigest()[:8]
        rules[name] = f'[data-style="{name}"] {{ {found[2]} }}\n'
        return f'{found[1]} data-style="{name}"'

    def script(found: re.Match[str]) -> str:
        return f'<script src="{_relative(_write(folder, found[1], "js"), page)}"></script>'

    def style(found: re.Match[str]) -> str:
        return f'<link rel="stylesheet" href="{_relative(_write(folder, found[1], "css"), page)}">'

    while _ATTRIBUTE.search(html):
        html = _ATTRIBUTE.sub(attribute, html)
    html = _STYLE.sub(style, _SCRIPT.sub(script, html))
    if rules:
        sheet = _write(folder, "".join(rules[name] for name in sorted(rules)), "css")
        html = html.replace("</head>", f'<link rel="stylesheet" href="{_relative(sheet, page)}">\n</head>', 1)
    return html


def _write(folder: Path, text: str, suffix: str) -> Path:
    text = unquote(text) if suffix == "svg" else text
    path = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}.{suffix}"
    path.write_text(text, encoding="utf-8")
    return path


def _relative(path: Path, page: Path) -> str:
    return Path(os.path.relpath(path, page.parent)).as_posix()
