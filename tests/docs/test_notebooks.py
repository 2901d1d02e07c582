"""The example notebooks: each runs from its first cell in an empty folder, and shows what is stored in it."""

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "extensions"))

from notebooks import NAMES, read, run_cells


def without_digits(text):
    """A text without its digits and blanks: the last digits differ from machine to machine."""
    return re.sub(r"[\d\s]+", "#", text)


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_shows_what_it_stores(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    cells = 0
    for cell, (text, picture) in run_cells(read(name)):
        stored = {each["output_type"]: each for each in cell["outputs"]}
        shown = "".join(stored.get("stream", {}).get("text", []))
        assert without_digits(text) == without_digits(shown), "run `python docs/extensions/notebooks.py`"
        assert (picture is not None) == ("display_data" in stored)
        cells += 1
    assert cells >= 4


def test_the_notebook_of_the_paper_compares_sets_of_the_same_postures():
    outputs = [each for cell in read("paper.ipynb")["cells"] for each in cell.get("outputs", ())]
    text = "".join("".join(each.get("text", ())) for each in outputs)
    assert "in 19 observations on both sides" in " ".join(text.split())
    assert "joint   side              CP/L              CP              PP             DPP" in text


@pytest.mark.parametrize("name", NAMES)
def test_each_cell_has_an_id_and_a_cell_shows_a_plot(name):
    cells = read(name)["cells"]
    ids = [cell["id"] for cell in cells]
    assert len(set(ids)) == len(cells)
    shown = [each["output_type"] for cell in cells for each in cell.get("outputs", ())]
    assert "display_data" in shown
