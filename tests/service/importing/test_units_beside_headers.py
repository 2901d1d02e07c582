"""A sheet for each posture, whose forces have their unit in the first cell of the row of their headers."""

import io

import numpy as np
import openpyxl
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=25, configurations=12)
SAG = np.array([0.01, 0.02, -0.5])
FORCE = [-47.0, -33.2, 109.2]
STATED = {"encoders": "motor", "load_point": [0, 0, 100]}


def write_workbook(title, below):
    """Return a workbook with a sheet for each posture; `below` is the first cell of the row of the force."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for number, (joints, places) in enumerate(zip(READINGS.joints, READINGS.position, strict=True), 1):
        sheet = book.create_sheet(f"Config {number}")
        angles = np.round(np.rad2deg(joints), 3).tolist()
        force = np.round(np.multiply(FORCE, 1 + 0.01 * number), 3).tolist()
        place = 1e3 * places[0]
        rows = [["Joint", "Angle (°)"], *([f"J{k}", each] for k, each in enumerate(angles, 1)), []]
        rows += [[title, "Fx", "Fy", "Fz"], [below, *force], []]
        rows.append(["Target", *(f"{axis} {state}" for state in ("unloaded", "loaded") for axis in "XYZ")])
        rows.append(["C1", *np.round(place, 4).tolist(), *np.round(place + SAG, 4).tolist()])
        for row in rows:
            sheet.append(row)
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


def read_sheets(folder, title, below=None):
    (folder / "a.xlsx").write_bytes(write_workbook(title, below))
    return js.read(folder / "a.xlsx", robot=ARM, **STATED)


@pytest.mark.parametrize(("title", "newtons"), [("Effort (N)", 1.0), ("Force [kN]", 1e3)])
def test_the_unit_before_the_headers_of_a_force_is_its_unit(tmp_path, title, newtons):
    measurement_set = read_sheets(tmp_path, title).accept().campaign.measurement_set
    unit = {"N": 1.0, "kN": 1e3}[measurement_set.units.force]
    forces = [np.multiply(unit, each.force) for each in measurement_set.observations]
    assert forces[0] == pytest.approx(newtons * 1.01 * np.array(FORCE), abs=2e-3 * newtons)


@pytest.mark.parametrize(("title", "below"), [("Effort", None), ("Effort (N)", 12.0)])
def test_no_unit_is_taken_of_a_cell_without_one_or_with_a_number_of_its_own(tmp_path, title, below):
    with pytest.raises(js.CampaignError, match="no unit"):
        read_sheets(tmp_path, title, below)
