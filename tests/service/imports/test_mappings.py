"""Mappings applied to tables: what a role reads, what the check finds, and what is asked."""

import numpy as np
import pytest
from support.importing_samples import LONG, answered, arm, numbers_of
from support.measured_arms import PLACES, measure
from support.slides import arm_on_rail

from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator.document import robot_document
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import KnownRobot

ARM = "ABB IRB 4600-60/2.05"
DEFLECTION = np.array([0.04, -0.03, -0.9])
FORCE = (0.0, 0.0, -600.0)
JOINTS = [f"J{n} [deg]" for n in range(1, 7)]


@pytest.fixture(scope="module")
def known():
    return arm(ARM)


def rows_of(header, *blocks):
    numbers = np.hstack([np.reshape(block, (len(block), -1)) for block in blocks])
    lines = [";".join(header), *(";".join(f"{each:.4f}" for each in row) for row in numbers)]
    return "\n".join(lines) + "\n"


def triple(name):
    return [f"{name} {axis} [mm]" for axis in "xyz"]


def in_two_states(known, loads=((0.0, 0.0), (60.0, 1.0)), header="mass [kg]"):
    """Return a long table in which the mass of each row is stated: posture, joints, mass, position."""
    joints, points = measure(known)
    lines = [";".join(["label", *JOINTS, header, *(f"{axis} [mm]" for axis in "xyz")])]
    for number, (q, place) in enumerate(zip(joints, points[:, 0], strict=True), 1):
        for mass, share in loads:
            cells = [*q, mass, *(place + share * DEFLECTION)]
            lines.append(f"p{number};" + ";".join(f"{each:.4f}" for each in cells))
    return "\n".join(lines) + "\n"


def test_the_mass_of_a_row_says_its_state_and_several_masses_are_observations(known):
    answer = answered(("a.csv", in_two_states(known, ((0.0, 0.0), (60.0, 0.5), (120.0, 1.0)))), robot=known)
    observations = answer.measurement_set.observations
    assert len(observations) == 2 * 16
    assert {round(-each.force[2] / 9.80665) for each in observations} == {60, 120}
    moved = np.subtract(observations[1].readings[0].loaded, observations[1].readings[0].unloaded)
    assert moved == pytest.approx(DEFLECTION, abs=1e-3)


def test_a_mass_above_zero_is_never_unloaded(known):
    answer = answered(("a.csv", in_two_states(known, ((60.0, 1.0),))), robot=known)
    assert (answer.measurement_set, answer.geometry) == (None, None) or answer.faults
    assert "were read under a load, and never without a load" in answer.faults[0]


def test_exchanged_states_of_some_postures_are_named_so(known):
    joints, points = measure(known)
    unloaded, loaded = points[:, 0].copy(), points[:, 0] + DEFLECTION
    unloaded[:6], loaded[:6] = loaded[:6].copy(), unloaded[:6].copy()
    header = [*JOINTS, *triple("P unloaded"), *triple("P loaded")]
    answer = answered(("a.csv", rows_of(header, joints, unloaded, loaded)), robot=known, force=FORCE)
    assert "6 of 16 deflections go against their force" in answer.faults[0]
    assert "their states are exchanged, or their forces are wrong" in answer.faults[0]


def test_a_position_that_lies_far_from_its_joints_is_named(known):
    joints, points = measure(known)
    unloaded, loaded = points[:, 0].copy(), points[:, 0] + DEFLECTION
    loaded[4, 1] += 120.0
    header = [*JOINTS, *triple("P unloaded"), *triple("P loaded")]
    answer = answered(("a.csv", rows_of(header, joints, unloaded, loaded)), robot=known, force=FORCE)
    assert [(each.posture, each.target, each.state) for each in answer.far] == [("5", "P", "loaded")]
    assert "do not belong to their joints (5 P)" in answer.faults[0]


def test_columns_in_several_units_have_a_role_for_each(known):
    joints, points = measure(known)
    header = [*JOINTS, *triple("P unloaded"), *(f"P loaded {axis} [m]" for axis in "xyz")]
    header[0] = "J1 [rad]"
    mixed = joints.copy()
    mixed[:, 0] = np.radians(joints[:, 0])
    table = np.hstack([mixed, points[:, 0], 1e-3 * (points[:, 0] + DEFLECTION)])
    lines = [";".join(header), *(";".join(f"{each:.7f}" for each in row) for row in table)]
    answer = answered(("a.csv", "\n".join(lines)), robot=known, force=FORCE)
    (label, _, force, targets), *_ = numbers_of(answer)
    assert (label, force) == ("1", FORCE)
    assert targets["P"][0] == pytest.approx(points[0, 0], abs=1e-3)
    assert np.subtract(targets["P"][1], targets["P"][0]) == pytest.approx(DEFLECTION, abs=2e-3)


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("mm", 1e3)])
def test_an_arm_on_a_rail_is_proposed_in_the_unit_of_its_numbers(unit, factor):
    robot = prepare_robot(RobotDocument.model_validate(robot_document(arm_on_rail()))).robot
    generator = np.random.default_rng(5)
    q = generator.uniform(-1.0, 1.0, (24, robot.n))
    q[:, 0] = generator.uniform(0.2, 2.5, 24)
    placed = Postures(robot, q + np.radians(0.02) * generator.standard_normal(robot.n))
    points = np.einsum("nij,j->ni", placed.flange_rotation, PLACES[0]) + placed.flange_translation
    shown = np.degrees(robot.joint_map.controller_angles(q))
    shown[:, 0] = factor * q[:, 0]
    loaded = 1e3 * points + DEFLECTION
    table = np.hstack([shown, 1e3 * points, loaded])
    text = "\n".join(" ".join(f"{each:.4f}" for each in row) for row in table)
    answer = answered(("a.txt", text), robot=KnownRobot("rail", robot), force=FORCE)
    roles = [(role.columns, role.unit) for role in answer.mapping.tables[0].roles if role.role == "joints"]
    assert roles == [("A", unit), ("B:G", "deg")]
    assert not answer.faults


def test_columns_of_postures_are_read_and_shown_as_rows(known):
    joints, points = measure(known)
    table = np.hstack([joints, points[:, 0], points[:, 0] + DEFLECTION]).T
    text = "\n".join(" ".join(f"{each:.4f}" for each in row) for row in table)
    answer = answered(("a.txt", text), robot=known, force=FORCE)
    assert answer.mapping.tables[0].transpose
    (view,) = answer.tables
    assert view.row_count == 16
    assert [column.role for column in view.columns][:7] == 6 * ["joints [deg]"] + ["T1 unloaded [mm]"]


def test_every_column_of_numbers_without_a_role_is_asked_about(known):
    joints, points = measure(known)
    header = [f"a{n}" for n in range(6)] + ["u", "v", "w", "k", "l", "m", "T [K]"]
    blocks = (joints, points[:, 0], points[:, 0] + DEFLECTION, 20.0 + np.arange(16.0)[:, None])
    answer = answered(("a.csv", rows_of(header, *blocks)), robot=known, force=FORCE)
    texts = [question.text for question in answer.questions]
    assert "not read: M (T [K]): is this right?" in texts


LAST = "c01;10.5;0;0;-1471.5;P11;loaded"
FAULTS = {
    "a word among numbers": ("c01;10.5;", "c01;ten;", "column B has 'ten' in row 1, where a number belongs"),
    "a gap in a position": ("1.5;2.25;3.125", "1.5;;3.125", "columns H:J have an empty cell in row 1"),
    "two joints": (LAST, LAST.replace("10.5", "12.5"), "two different joints"),
    "two forces": (LAST, LAST.replace("0;0;", "0;9;"), "two different forces"),
    "another word of a state": ("P10;unloaded;1.5", "P10;heavy;1.5", "the word 'heavy' is no state"),
}


@pytest.mark.parametrize(("old", "new", "said"), FAULTS.values(), ids=FAULTS)
def test_a_cell_that_cannot_be_right_is_named_with_its_place(old, new, said):
    assert old in LONG
    answer = answered(("a.csv", LONG.replace(old, new, 1)))
    assert answer.measurement_set is None
    assert said in answer.questions[0].text


def test_a_text_in_another_encoding_asks_for_the_encoding():
    content = LONG.replace("P10", "Süd").encode("latin-1")
    question, *_ = answered(("a.csv", content)).questions
    assert question.text == "a.csv: the file is not encoded in UTF-8: which encoding has it?"
    chosen = question.choices[0].mapping
    assert chosen.encoding == "windows-1252"
    found = numbers_of(answered(("a.csv", content), encoding=chosen.encoding))
    assert set(found[0][3]) == {"Süd", "P11"}


def test_displacements_without_positions_ask_for_the_places_of_the_targets():
    table = "label;J1 [deg];J2 [deg];mass [kg];P1 dx [mm];P1 dy [mm];P1 dz [mm]\n"
    table += "a;1;2;50;0.01;0.02;-0.5\nb;3;4;50;0.01;0.01;-0.4\nc;5;6;50;0.01;0.02;-0.3\n"
    question, *_ = answered(("a.csv", table)).questions
    assert question.text == "where on the flange are the targets P1 [mm]?"
    answer = answered(("a.csv", table), flange_targets={"P1": (0.0, 0.0, 200.0)})
    assert answer.measurement_set.observations[0].readings[0].deflection == (0.01, 0.02, -0.5)


def test_an_uncertainty_of_a_point_is_that_of_three_coordinates():
    table = LONG.replace("z [mm]", "z [mm];U95 [mm]").replace("125\n", "125;0.0679\n")
    answer = answered(("a.csv", table))
    assert answer.measurement_set.observations[0].readings[0].sigma == pytest.approx(0.02, rel=1e-3)
