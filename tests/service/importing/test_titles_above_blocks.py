"""Titles of two cells above the blocks of a sheet: they are no group of the columns below."""

import io

import numpy as np
import openpyxl
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=25, configurations=12)
FIRST = 1e3 * READINGS.position[:, 0]
SAG = np.array([0.01, 0.02, -0.5])
TITLE = "Universal Robots UR10e"
LOAD = "5 кгс, динамометр, вдоль -Y базы"
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}


def write_workbook(between):
    """Return a sheet of two blocks, with titles and `between` above them."""
    book = openpyxl.Workbook()
    sheet = book.active
    axes = ["X, мм", "Y, мм", "Z, мм"]
    joints = [f"A{number}, град" for number in range(1, 7)]
    rows = [["Робот", TITLE], ["Усилие", LOAD], *between, ["№", "Без нагрузки"], ["№", *joints, *axes]]
    for number, (angles, place) in enumerate(zip(np.rad2deg(READINGS.joints), FIRST, strict=True), 1):
        rows.append([number, *np.round(angles, 3).tolist(), *np.round(place, 4).tolist()])
    rows += [[], ["№", "С нагрузкой"], ["№", *axes]]
    for number, place in enumerate(FIRST + SAG, 1):
        rows.append([number, *np.round(place, 4).tolist()])
    for row in rows:
        sheet.append(row)
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


@pytest.mark.parametrize("between", [[[]], []], ids=["an empty row", "no empty row"])
def test_a_title_is_neither_a_header_nor_the_name_of_a_target(tmp_path, between):
    (tmp_path / "a.xlsx").write_bytes(write_workbook(between))
    answer = js.read(tmp_path / "a.xlsx", robot=ARM, **STATED).accept()
    readings = [each for own in answer.campaign.measurement_set.observations for each in own.readings]
    assert {each.target for each in readings} == {"T1"}
    shifts = [np.subtract(each.loaded, each.unloaded) for each in readings]
    assert shifts == pytest.approx(np.tile(SAG, (12, 1)), abs=1e-3)
    headers = [column.header for file in answer.files for column in file.columns]
    assert not any(TITLE in header or "динамометр" in header for header in headers)
