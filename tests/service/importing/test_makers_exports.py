"""Exports of instruments and controllers as their makers write them, read by one proposal."""

import io

import numpy as np
import openpyxl
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=11, configurations=10)
DEGREES = np.rad2deg(READINGS.joints)
UNLOADED = 1e3 * READINGS.position[:, 0]
LOADED = UNLOADED - [0.0, 0.0, 0.4]
COUNT = len(DEGREES)
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}
NUMBERS = np.column_stack([DEGREES, UNLOADED, LOADED])


def propose(folder, **files):
    paths = []
    for name, content in files.items():
        path = folder / name.replace("__", ".")
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        paths.append(path)
    return js.read(*paths, robot=ARM, **STATED)


def assert_read(proposal, count=COUNT):
    observations = proposal.accept().measurement_set.observations
    assert len(observations) == count
    joints = [observation.joints for observation in observations]
    assert np.abs(np.array(joints) - DEGREES[:count]).max() < 1e-3
    for observation in observations:
        for reading in observation.readings:
            assert np.subtract(reading.loaded, reading.unloaded) == pytest.approx([0, 0, -0.4], abs=2e-3)


# ---- rows of numbers are read, said or refused

HEADER = "\t".join(
    [f"J{i} [deg]" for i in range(1, 7)]
    + [f"{axis} {state} [mm]" for state in ("free", "loaded") for axis in "XYZ"]
)


def channels(*, remarks=(), preamble=(), footer=(), rows=NUMBERS):
    lines = ["LabVIEW Measurement", "Separator\tTab", "***End_of_Header***", "", *preamble]
    lines += ["X_Value\t" + HEADER + "\tComment"]
    for number, row in enumerate(rows.tolist()):
        cells = [f"{number}.000000", *(f"{value:.6f}" for value in row)]
        lines.append("\t".join([*cells, *(["calibrated"] if number in remarks else [])]))
    return "\n".join([*lines, *footer]) + "\n"


def test_lines_of_channels_above_a_header_are_no_postures_and_are_said(tmp_path):
    preamble = ["Samples" + "\t10" * 12, "X0" + "\t0.0E+0" * 12, "Delta_X" + "\t1.0" * 12]
    proposal = propose(tmp_path, rope__lvm=channels(preamble=preamble))
    assert_read(proposal)
    assert "rows of numbers outside the table were not read: 5 ('Samples')" in str(proposal)


@pytest.mark.parametrize("remarks", [(0,), (4,), (9,), (0, 1, 2, 3, 4, 5, 6)])
def test_a_row_with_a_remark_behind_its_last_column_is_a_posture(remarks, tmp_path):
    assert_read(propose(tmp_path, rope__lvm=channels(remarks=remarks)))


def test_a_row_of_a_table_that_lacks_a_number_is_refused_at_its_line(tmp_path):
    lines = channels().splitlines()
    lines[7] = lines[7].rpartition("\t")[0]
    with pytest.raises(js.CampaignError, match="line 8: the row has 12 cells, but the other rows"):
        propose(tmp_path, rope__lvm="\n".join(lines) + "\n")


def test_rows_of_numbers_below_a_table_are_said(tmp_path):
    proposal = propose(tmp_path, rope__lvm=channels(footer=["", "Tool\t0\t0\t150"]))
    assert_read(proposal)
    assert "not read: 17 ('Tool')" in str(proposal)


# ---- postures as columns


def sheet(*rows):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append([cell or None for cell in row])
    output = io.BytesIO()
    book.save(output)
    return output.getvalue()


JOINT_ROWS = [[f"Axel {n}", "grader", *column] for n, column in enumerate(DEGREES.T.round(4).tolist(), 1)]
STATE_ROWS = {
    state: [[axis, "mm", *column] for axis, column in zip("XYZ", numbers.T.round(4).tolist(), strict=True)]
    for state, numbers in (("Utan last", UNLOADED), ("Med last", LOADED))
}
POSES = ["Pos.", "", *range(1, COUNT + 1)]


def test_a_sheet_of_columns_below_a_title_with_groups_in_titles_is_read(tmp_path):
    groups = [row for state, rows in STATE_ROWS.items() for row in ([], [state], *rows)]
    rows = [["Styvhetsprov cell 3"], [], POSES, ["Ledvinklar"], *JOINT_ROWS, *groups]
    assert_read(propose(tmp_path, t__xlsx=sheet(*rows)))


def test_a_sheet_of_columns_with_groups_in_merged_cells_is_read(tmp_path):
    groups = [
        [state if axis == 0 else "", *row]
        for state, rows in STATE_ROWS.items()
        for axis, row in enumerate(rows)
    ]
    joints = [["", *row] for row in JOINT_ROWS]
    assert_read(propose(tmp_path, t__xlsx=sheet(["Test"], ["", *POSES], *joints, *groups)))
