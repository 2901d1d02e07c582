"""Loads of a program by lines and by a table of points: forces, moments, and what is refused."""

import numpy as np
import pytest
from support.programs import (
    FORCE,
    corrected,
    corrected_with_table,
    exact_run,
    flat,
    path,
    request,
    tool_poses,
)

from jointstiff.service.kinds.correction.files import compress_file, decompress_file
from jointstiff.service.kinds.correction.loads import read_load_table
from jointstiff.service.kinds.correction.programs import ProgramWork
from jointstiff.service.problems import FilesError
from jointstiff.simulator.programs import program_text
from jointstiff.solver.errors import RequestError

TEXT = program_text("krl", tool_poses(path(4)), 4)
HEADER = "point,Fx [N],Fy [N],Fz [N]"
COLUMNS = (
    "write `point`, `label` or `length [mm]`, then Fx [N], Fy [N], Fz [N], and, if known, "
    "Mx [N.m] … and feed [mm/s]"
)
ONCE = "number the points from 1 to 4, and give each point at most once"


def moved_lines(result):
    """Lines with other numbers than before."""
    new = decompress_file(result.files[0]).decode().split("\r\n")
    return [i for i, (a, b) in enumerate(zip(TEXT.split("\r\n"), new, strict=True), 1) if a != b]


def test_a_table_has_forces_and_moments_in_any_order_and_unit():
    units = {"length": "mm", "angle": "deg", "force": "N", "moment": "N.m"}
    load = {"force": FORCE, "moment": (150.0, -80.0, 40.0)}
    stated = corrected("krl", TEXT, units=units, force=None, segments=[load])
    header = "point,Fx [N],Mz [N.mm],Fz [kN],Fy [N],Mx [N.m],My [kN.m]"
    rows = "".join(f"{point},300,40000,-1.4,400,150,-0.08\n" for point in range(1, 5))
    of_table = corrected_with_table(TEXT, f"{header}\n{rows}")
    assert decompress_file(of_table.files[0]) == decompress_file(stated.files[0])
    forces_alone = corrected("krl", TEXT)
    assert of_table.deflection.greatest != pytest.approx(forces_alone.deflection.greatest, rel=1e-3)


def test_points_that_a_table_omits_have_no_load():
    result = corrected_with_table(TEXT, f"{HEADER}\n4,300,400,-1400\n\n2,300,400,-1400\n")
    assert moved_lines(result) == [8, 10]
    assert (result.corrected, result.left_alone) == (2, {"no_load": 2})


def by_labels(rows):
    """The result of FANUC's program, whose targets have names, under a table of labels."""
    asked = request("fanuc", program_text("fanuc", tool_poses(path(4)), 4))
    files = [*asked.files, compress_file("loads.csv", f"label{HEADER[5:]}\n{rows}".encode())]
    changed = asked.model_copy(update={"force": None, "loads": "loads.csv", "files": files})
    robot, run = exact_run()
    return flat(ProgramWork(robot, "robot", run, changed).conclude(()))


@pytest.mark.parametrize("header", ["Label", " label", "LABEL "])
def test_the_first_header_is_read_in_any_case(header):
    """A label that is a number is never taken for the number of a point."""
    loads = read_load_table(
        f"{header},Fx [N],Fy [N],Fz [N]\n3,1,0,0\n".encode(), np.array([1, 2, 3]), ["3", "1", "2"], np.zeros
    )
    assert loads.values[loads.of_visit, 0].tolist() == [1.0, 0.0, 0.0]


def test_a_point_has_no_unit():
    with pytest.raises(FilesError, match="first header"):
        read_load_table(b"point [mm],Fx [N],Fy [N],Fz [N]\n1,1,0,0\n", np.array([1]), [""], np.zeros)


def test_a_table_may_name_targets_by_their_labels():
    result = by_labels("p[4],300,400,-1400\nP[2],300,400,-1400\n")
    assert (result.corrected, result.left_alone) == (2, {"no_load": 2})
    assert {point.name for point in result.worst} == {"P[2]", "P[4]"}
    with pytest.raises(FilesError, match=r"loads:2: the label .P\[9\]. is not the name of one target"):
        by_labels("P[9],300,400,-1400\n")


PLACES = np.round(1e3 * tool_poses(path(4))[:, :3, 3], 4)
WAY = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(PLACES, axis=0), axis=1)))
"""Lengths of the path up to its points [mm]."""
BY_LENGTH = f"length [mm]{HEADER[5:]}"


def by_length(rows):
    lines = "".join(",".join(repr(float(each)) for each in row) + "\n" for row in rows)
    return corrected_with_table(TEXT, f"{BY_LENGTH}\n{lines}")


def by_points(forces):
    rows = "".join(f"{i},{','.join(map(repr, map(float, force)))}\n" for i, force in enumerate(forces, 1))
    return corrected_with_table(TEXT, f"{HEADER}\n{rows}")


def test_a_table_by_length_is_interpolated_at_the_points():
    at = np.array([0.0, 0.4, 0.7, 1.0]) * WAY[-1]
    force = np.array([[300.0, 400.0, -1400.0], [100.0, 0.0, -700.0], [0.0, 50.0, -900.0], [10.0, 0.0, -20.0]])
    expected = np.column_stack([np.interp(WAY, at, column) for column in force.T])
    found, wanted = by_length(np.column_stack([at, force])), by_points(expected)
    assert found.corrected == 4
    assert decompress_file(found.files[0]) == decompress_file(wanted.files[0])
    assert found.deflection.greatest == pytest.approx(wanted.deflection.greatest, rel=1e-9)


def test_two_rows_of_one_length_are_a_step_of_the_load():
    middle, force = 0.5 * (WAY[1] + WAY[2]), list(FORCE)
    none = [0.0, 0.0, 0.0]
    rows = [[0.0, *none], [middle, *none], [middle, *force], [WAY[-1], *force]]
    found = by_length(rows)
    assert (found.corrected, found.left_alone) == (2, {"no_load": 2})
    assert moved_lines(found) == [9, 10]


def test_a_line_from_joint_angles_counts_and_joint_moves_do_not():
    home = path(4)[0] + np.radians([2.0, -3.0, 2.0, 0.0, 1.0, 0.0])
    angles = ",".join(f"A{i} {each!r}" for i, each in enumerate(np.degrees(home).tolist(), 1))
    text = TEXT.replace("LIN {", f"PTP {{{angles}}}\r\nLIN {{", 1)
    approach = 1e3 * np.linalg.norm(tool_poses(home[None])[0, :3, 3] - 1e-3 * PLACES[0])
    ends = [0.0, approach, approach + WAY[-1]]
    rows = "".join(f"{at!r},0,0,{-1.0 * (at > 0.0) * (1.0 + at)!r}\n" for at in map(float, ends))
    found = corrected_with_table(text, f"{BY_LENGTH}\n{rows}")
    wanted = -1.0 * (1.0 + approach + WAY)
    numbered = "".join(f"{i},0,0,{force!r}\n" for i, force in enumerate(wanted.tolist(), 2))
    by_number = corrected_with_table(text, f"{HEADER}\n{numbered}")
    assert found.moves == 5
    assert found.left_alone == {"no_load": 1}
    assert decompress_file(found.files[0]) == decompress_file(by_number.files[0])
    with pytest.raises(FilesError, match="joint moves"):
        corrected_with_table(TEXT.replace("LIN", "PTP"), f"{BY_LENGTH}\n{rows}")


def test_a_huge_table_by_length_is_refused_before_it_is_split():
    with pytest.raises(FilesError, match="at most 100,000 lines"):
        corrected_with_table(TEXT, f"{BY_LENGTH}\n" + "\n" * 100_001)


REFUSED = {
    "a table by length without a unit": (
        "length,Fx [N],Fy [N],Fz [N]\n0,0,0,9\n",
        "loads:1: the header 'length' has no unit of length; write `length [mm]`",
    ),
    "lengths that decrease": (
        f"{BY_LENGTH}\n0,0,0,9\n50,0,0,9\n40,0,0,9\n",
        "loads:4: the length 40 mm is less than that of the row before, or occurs three times; sort the rows "
        "by length; two rows of one length are a step of the load",
    ),
    "a gap at the end of the path": (
        f"{BY_LENGTH}\n0,0,0,9\n50,0,0,9\n",
        "loads:3: the table covers 0 to 50 mm, but the lines and arcs of the path have 0 to "
        f"{WAY[-1]:.4g} mm; give rows for the whole path, with zeros where there is no load",
    ),
    "an unknown header": (
        "point,Fx [N],Fq [N],Fz [N]\n1,0,0,9\n",
        f"loads:1: the header 'Fq [N]' is not understood; {COLUMNS}",
    ),
    "no column of Fz": (
        "point,Fx [N],Fy [N]\n1,0,0\n",
        f"loads:1: a column is missing, or occurs twice; {COLUMNS}",
    ),
    "a column twice": (
        f"{HEADER},Fx [N]\n1,0,0,9,0\n",
        f"loads:1: a column is missing, or occurs twice; {COLUMNS}",
    ),
    "no point": (
        f"{HEADER[6:]}\n0,0,9\n",
        f"loads:1: a column is missing, or occurs twice; {COLUMNS}",
    ),
    "a word": (
        f"{HEADER}\n1,0,0,9\n2,0,0,x\n",
        "loads:3: a cell is not a number; write numbers with decimal points",
    ),
    "a row that is short": (
        f"{HEADER}\n1,0,0\n",
        "loads:2: a cell is missing, or a number is out of range; give a finite number in each column",
    ),
    "a force beyond all": (
        f"{HEADER}\n1,0,0,1.1e9\n",
        "loads:2: a cell is missing, or a number is out of range; give a finite number in each column",
    ),
    "point 0": (
        f"{HEADER}\n0,0,0,9\n",
        f"loads:2: point 0 occurs twice, or is not in the program; {ONCE}",
    ),
    "point 5 of 4": (
        f"{HEADER}\n4,0,0,9\n5,0,0,9\n",
        f"loads:3: point 5 occurs twice, or is not in the program; {ONCE}",
    ),
    "a point twice": (
        f"{HEADER}\n2,0,0,9\n2,0,0,9\n",
        f"loads:3: point 2 occurs twice, or is not in the program; {ONCE}",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_table_that_is_not_certain_is_refused_with_its_line(case):
    table, words = REFUSED[case]
    with pytest.raises(FilesError) as refused:
        corrected_with_table(TEXT, table)
    assert str(refused.value) == words


def segments(*lines):
    return [{"first_line": first, "last_line": last, "force": FORCE} for first, last in lines]


def test_segments_may_stand_in_any_order_and_follow_one_another():
    result = corrected("krl", TEXT, force=None, segments=segments((9, 9), (7, 8)))
    assert moved_lines(result) == [7, 8, 9]


def test_a_line_with_two_loads_is_refused():
    with pytest.raises(RequestError) as refused:
        corrected("krl", TEXT, force=None, segments=segments((9, 10), (7, 9)))
    assert str(refused.value) == (
        "segments[0]: line 9 has two loads; give segments of lines that do not overlap"
    )
