"""Figures of one commit in docs/figures.md, between two markers; settled ones stand below, by hand."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from benchmarks.report import Figure

__all__ = ["refuse_changes", "rewritten", "write"]

ROOT: Final = Path(__file__).parents[1]
PAGE: Final = ROOT / "docs" / "figures.md"
BEGIN, END = "<!-- recorded -->", "<!-- /recorded -->"


def refuse_changes() -> None:
    """End the program if the checkout has changes: its figures would be of no commit."""
    if changes := _git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs/figures.md"):
        sys.exit(f"--record measures a commit, and these files have changes:\n{changes}")


def write(found: Mapping[str, Sequence[Figure]]) -> None:
    """Replace the rows of benchmarks on the page; rows of another commit go."""
    commit = _git("show", "-s", "--format=%h of %cs", "HEAD")
    of = f"Commit {commit}, {os.cpu_count()} processors:"
    PAGE.write_text(rewritten(PAGE.read_text(encoding="utf-8"), of, found), encoding="utf-8")


def rewritten(page: str, of: str, found: Mapping[str, Sequence[Figure]]) -> str:
    """Return the page with the figures of benchmarks, sorted by name.

    Args:
        page: its text, with both markers.
        of: line that states commit and machine; rows that stand below another one are dropped.
        found: figures by benchmark.
    """
    before, _, rest = page.partition(BEGIN)
    old, _, after = rest.partition(END)
    rows = [line for line in old.splitlines() if line.startswith("| `")] if f"\n{of}\n" in old else []
    kept = [row for row in rows if row.split("`")[1] not in found]
    new = [_row(name, each) for name, figures in found.items() for each in _by_what(figures)]
    table = "\n".join(sorted([*kept, *new], key=lambda row: row.split("`")[1]))
    heads = "| benchmark | figure | measured | required |\n|---|---|---|---|"
    return f"{before}{BEGIN}\n{of}\n\n{heads}\n{table}\n{END}{after}"


def _by_what(figures: Sequence[Figure]) -> list[list[Figure]]:
    """Group figures that differ only in what is required: one number may have two bounds."""
    groups: dict[tuple[str, float, str], list[Figure]] = {}
    for figure in figures:
        groups.setdefault((figure.what, figure.measured, figure.unit), []).append(figure)
    return list(groups.values())


def _row(name: str, figures: Sequence[Figure]) -> str:
    """Write the row of one number and its bounds."""
    signs = {"at least": "≥", "at most": "≤"}
    required = ", ".join(f"{signs[each.relation]} {each.required:g}{each.unit}" for each in figures)
    missed = "" if all(each.met for each in figures) else " **not met**"
    what = figures[0].what.replace("|", "\\|")
    return f"| `{name}` | {what} | {figures[0].measured:.3g}{figures[0].unit}{missed} | {required} |"


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=ROOT, check=True, capture_output=True, text=True)  # noqa: S607
    return done.stdout.strip()
