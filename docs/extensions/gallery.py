"""Draw the pictures of docs/gallery.md by the program on that page: `python docs/extensions/gallery.py`."""

from __future__ import annotations

import contextlib
import re
import tempfile
from pathlib import Path

import matplotlib

from jointstiff.simulator.files import example_files

DOCS = Path(__file__).parents[1]
SAME = {"svg.fonttype": "none", "svg.hashsalt": "jointstiff", "savefig.dpi": 72}
"""Text stays text, and the same numbers give the same file."""


def main() -> None:
    """Run the program in an empty folder, and keep what it draws."""
    matplotlib.use("svg")
    matplotlib.rcParams |= SAME
    (program,) = re.findall(r"```python\n(.*?)```", (DOCS / "gallery.md").read_text(encoding="utf-8"), re.S)
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        for file, text in example_files():
            Path(file).write_text(text, encoding="utf-8")
        exec(program, {})  # noqa: S102 - of this repository
        for picture in Path().glob("*.svg"):
            lines = picture.read_text(encoding="utf-8").splitlines()
            text = "\n".join(line.rstrip() for line in lines if "<dc:date>" not in line)
            (DOCS / "images" / "gallery" / picture.name).write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
