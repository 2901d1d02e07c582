"""The recipes of CONTRIBUTING: their files exist, their code works, and a reader finds what they promise."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from textwrap import dedent
from typing import get_args

import numpy as np
import pytest
from support.campaigns import prepare

from jointstiff.schemas.finding import Finding, FindingCode
from jointstiff.schemas.imports import FilePreview, ImportOptions
from jointstiff.service.importing.errors import Faults
from jointstiff.service.importing.grid import Grid, Row
from jointstiff.service.importing.layout import lay_out
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.integrity.values import View

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def recipe(title: str) -> str:
    """Return the section of a title."""
    return TEXT.split(f"## {title}\n")[1].split("\n## ")[0]


def defined(title: str, name: str):
    """Return the function that the code of a recipe defines."""
    (code,) = re.findall(r"^   ```python\n(.*?)^   ```$", recipe(title), re.MULTILINE | re.DOTALL)
    names = {
        "FilePreview": FilePreview,
        "Finding": Finding,
        "Grid": Grid,
        "Iterator": Iterator,
        "Row": Row,
        "View": View,
        "np": np,
    }
    exec(compile(dedent(code), title, "exec"), names)  # noqa: S102
    return names[name]


@pytest.mark.parametrize(
    "title", ["Add a kind of work", "Add a finding of the integrity checks", "Add an import format"]
)
def test_a_recipe_has_at_most_ten_steps(title):
    assert 5 <= len(re.findall(r"^\d+\. ", recipe(title), re.MULTILINE)) <= 10


def test_the_finding_of_the_recipe_is_found():
    check = defined("Add a finding of the integrity checks", "light_loads")
    robot, measurements = prepare(simulate_campaign(default_arm(), load="pull", configurations=4, seed=5))
    weak = replace(measurements, force=measurements.force * np.array([1.0, 0.01, 1.0, 0.01])[:, None])
    findings = list(check(View(robot, weak)))
    assert [(finding.observation, finding.weight) for finding in findings] == [("c02", "use"), ("c04", "use")]


def test_the_format_of_the_recipe_is_understood():
    read = defined("Add an import format", "read_pipes")
    faults = Faults()
    grid = read("day.txt", b"name|x [mm]|y [mm]|z [mm]\nc01_P10_loaded|1|2|3\n")
    layout = lay_out(grid, ImportOptions(), faults)
    assert not faults.found
    assert dict(layout.columns.units) == {"length": "mm"}


def test_every_finding_has_a_row_in_a_guide():
    guides = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md"))
    codes = get_args(FindingCode)
    assert sorted(code for code in codes if f"`{code}`" not in guides) == []
