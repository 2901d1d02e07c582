"""Run the example notebooks and write their outputs: `python docs/extensions/notebooks.py`."""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = ("jointstiff.ipynb", "paper.ipynb")


def main() -> None:
    """Run each notebook in an empty folder, and keep what its cells print and draw."""
    for name in NAMES:
        notebook = read(name)
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            for cell, (text, picture) in run_cells(notebook):
                cell["outputs"] = _outputs(text, picture)
        written = json.dumps(notebook, indent=1, ensure_ascii=False)
        (EXAMPLES / name).write_text(f"{written}\n", encoding="utf-8")


def read(name: str) -> dict[str, Any]:
    """Return a notebook of the examples."""
    notebook: dict[str, Any] = json.loads((EXAMPLES / name).read_text(encoding="utf-8"))
    return notebook


def run_cells(notebook: dict[str, Any]) -> Iterator[tuple[dict[str, Any], tuple[str, bytes | None]]]:
    """Run the cells of code one after the other; yield each with its text and its picture (PNG) or None."""
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        program = ast.parse("".join(cell["source"]))
        last = program.body.pop() if program.body and isinstance(program.body[-1], ast.Expr) else None
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(program, "cell", "exec"), names)  # noqa: S102 - of this repository
            value, is_shown = None, not "".join(cell["source"]).rstrip().endswith(";")
            if isinstance(last, ast.Expr):
                value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)  # noqa: S307
        value = value if is_shown else None
        picture = value._repr_png_() if hasattr(value, "_repr_png_") else None
        shown = "" if value is None or picture is not None else f"{value!r}\n"
        yield cell, (printed.getvalue() + shown, picture)


def _outputs(text: str, picture: bytes | None) -> list[dict[str, Any]]:
    """Return the outputs of a cell, as a notebook has them."""
    outputs: list[dict[str, Any]] = []
    if text:
        outputs.append({"name": "stdout", "output_type": "stream", "text": text.splitlines(keepends=True)})
    if picture is not None:
        data = {"image/png": base64.b64encode(picture).decode()}
        outputs.append({"data": data, "metadata": {}, "output_type": "display_data"})
    return outputs


if __name__ == "__main__":
    os.environ["COLUMNS"] = "100"
    main()
