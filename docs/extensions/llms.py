"""llms.txt: the map of the documentation for language models, made from the index (https://llmstxt.org)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

__all__ = ["llms_text", "setup"]

_ROW = re.compile(r"^\* ([^:\n]+): (\[.*\]\(.*\))$", re.MULTILINE)
_LINK = re.compile(r"\[([^\]]+)\]\(([^)]+)\.md\)")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("build-finished", _on_finished)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def llms_text(index: str) -> str:
    """Return the title, the first paragraph and the pages of an index, each with the task that it is for."""
    title, _, rest = index.partition("\n\n")
    summary = " ".join(rest.partition("\n\n")[0].split())
    pages = [
        f"- [{name[0].upper()}{name[1:]}]({page}.html): {task}"
        for task, links in _ROW.findall(index)
        for name, page in _LINK.findall(links)
    ]
    return "\n".join([title, "", f"> {summary}", "", "## Pages by task", "", *pages, ""])


def _on_finished(app: Sphinx, exception: Exception | None) -> None:
    if exception is None and app.builder.format == "html":
        text = llms_text(Path(app.srcdir, "index.md").read_text(encoding="utf-8"))
        Path(app.outdir, "llms.txt").write_text(text, encoding="utf-8")
