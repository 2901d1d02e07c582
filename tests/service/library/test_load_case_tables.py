"""Tables of load cases: numbers become radians and metres; what is refused, with its place."""

import pytest

from jointstiff.service.library.cases import make_load_cases
from jointstiff.service.runs.deflection import read_load_cases
from jointstiff.solver.errors import RequestError

HEADER = "label,J1 [deg],J2 [deg],J3 [mm],Fx [N],Fy [N],Fz [N]\n"
ROW = "drill,10.5,-20,30,200,300,-800.5\n"
JOINTS = {"a": "revolute", "b": "revolute", "c": "prismatic"}
COLUMNS = "give one column for each joint and three for each vector"


@pytest.mark.parametrize(("units", "slide"), [({}, 0.03), ({"units": {"length": "mm"}}, 30.0)])
def test_joints_of_a_table_are_in_radians_and_the_unit_of_length(units, slide):
    read = read_load_cases(HEADER + ROW.replace("drill", "\n,,,,,,\ndrill"), JOINTS, **units)
    (case,) = read.cases
    assert [*case.joints] == pytest.approx([0.18325957, -0.34906585, slide])
    assert (case.label, case.force) == ("drill", (200.0, 300.0, -800.5))
    assert (read.absolute, read.confidence, read.units.angle) == (False, 0.95, "rad")


def test_a_table_may_have_semicolons():
    assert read_load_cases((HEADER + ROW).replace(",", ";"), JOINTS).cases[0].force[2] == -800.5


@pytest.mark.parametrize(
    ("old", "new", "where", "said"),
    [
        ("J1 [deg]", "J1", "line 1",
         "the header 'J1' has no unit; write one of [rad], [deg] behind the name"),
        ("J1 [deg]", "J1 [grad]", "line 1",
         "the header 'J1 [grad]' has the unit grad; write one of [rad], [deg] behind the name"),
        ("J1 [deg]", "J4 [deg]", "line 1",
         "the header 'J4 [deg]' is not known; "
         "use label, J1 [deg], Fx [N], Mx [N.m], load point x [mm], place x [mm], direction x, …"),
        ("J2 [deg]", "J1 [deg]", "line 1", f"the column J1 occurs twice; {COLUMNS}"),
        (",Fz [N]", ",direction x", "line 1", f"the column Fz is missing; {COLUMNS}"),
        (",-800.5", ",strong", "line 2, column 7", "'strong' is not a number; write a number"),
        (
            *(",-800.5", "", "line 2"),
            "the row has 6 cells, but the table has 7 headers; give a cell for each header",
        ),
        (ROW, "", "line 1", "the table has no load cases; give a header and one row per case"),
        (ROW, "\n,,\n", "line 1", "the table has no load cases; give a header and one row per case"),
        (",-800.5", ",nan", "cases.0.force.2", "Input should be a finite number; correct the value"),
    ],
)  # fmt: skip
def test_a_table_of_load_cases_with_a_fault_is_refused(old, new, where, said):
    with pytest.raises(RequestError) as caught:
        read_load_cases((HEADER + ROW).replace(old, new), JOINTS)
    assert (caught.value.where, str(caught.value)) == (where, f"{where}: {said}")


@pytest.mark.parametrize("units", ["mm", None, {"length": "inch"}])
def test_units_of_a_table_are_those_of_load_cases(units):
    with pytest.raises(
        RequestError, match=r"units(\.length)?: Input should be (a valid dictionary|'m' or 'mm')"
    ):
        read_load_cases(HEADER + ROW, JOINTS, units=units)


def test_small_angles_in_stated_degrees_are_degrees():
    """Angles of an arm near its zero may be radians, but not if the caller states degrees."""
    angles = {"a": 0.25, "b": -1.75, "c": 30.0}
    with pytest.raises(RequestError, match="they seem to be radians"):
        make_load_cases([[*angles.values()]], JOINTS, [0, 0, -500], {"at": [0, 0, 120]})
    stated = {"at": [0, 0, 120], "units": {"angle": "deg"}}
    request = make_load_cases([[*angles.values()]], JOINTS, [0, 0, -500], stated)
    assert [*request.cases[0].joints] == [*angles.values()]
