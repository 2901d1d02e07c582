"""Workbooks whose numbers are texts: the texts show their decimal mark, and the robot confirms it."""

import io

import numpy as np
import openpyxl
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=33, configurations=12)
FIRST = 1e3 * READINGS.position[:, 0]
SAG = np.array([0.01, 0.02, -0.5])
HEADER = [
    "Nr.",
    *(f"A{i}" for i in range(1, 7)),
    *(f"{c} leer" for c in "xyz"),
    *(f"{c} mit Last" for c in "xyz"),
]
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}


def write(path, mark, *, digits=3, has_native_decimals=False):
    book = openpyxl.Workbook()
    book.active.append(HEADER)
    table = np.hstack([np.rad2deg(READINGS.joints), FIRST, FIRST + SAG])
    for number, row in enumerate(table.tolist(), 1):
        texts = [f"{value:.{digits}f}".replace(".", mark) for value in row]
        book.active.append([number, *texts[:-1], row[-1] if has_native_decimals else texts[-1]])
    output = io.BytesIO()
    book.save(output)
    path.write_bytes(output.getvalue())


@pytest.mark.parametrize("mark", [",", "."], ids=["comma", "point"])
def test_texts_of_a_sheet_have_the_decimal_mark_that_they_show(tmp_path, mark):
    write(tmp_path / "m.xlsx", mark)
    proposal = js.read(tmp_path / "m.xlsx", robot=ARM, **STATED)
    assert ("texts read with a decimal comma" in str(proposal)) == (mark == ",")
    observations = proposal.accept().campaign.measurement_set.observations
    assert len(observations) == len(FIRST)
    for own in observations:
        (each,) = own.readings
        assert np.allclose(np.subtract(each.loaded, each.unloaded), SAG, atol=2e-3)


def test_previews_show_numbers_of_a_sheet_with_fifteen_digits(tmp_path):
    book = openpyxl.Workbook()
    book.active.append(HEADER)
    for number, row in enumerate(np.hstack([np.rad2deg(READINGS.joints), FIRST, FIRST + SAG]).tolist(), 1):
        book.active.append([number, *row])
    book.save(tmp_path / "m.xlsx")
    proposal = js.read(tmp_path / "m.xlsx", robot=ARM, **STATED)
    cells = [cell for row in proposal.accept().files[0].first_rows for cell in row]
    assert max(sum(map(str.isdigit, cell.lstrip("-0."))) for cell in cells) <= 15


def test_texts_beside_numbers_with_decimals_leave_the_mark_open(tmp_path):
    write(tmp_path / "m.xlsx", ",", has_native_decimals=True)
    with pytest.raises(js.CampaignError, match="decimal_mark"):
        js.read(tmp_path / "m.xlsx", robot=ARM, **STATED)
