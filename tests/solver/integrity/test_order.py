"""Rows in another order, and deflections given as positions: named by the cause that the positions prove."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import first_target, prepare

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.mechanics.postures import Postures

COUNT = 15
ROBOT, CAMPAIGN = prepare(simulate_campaign(default_arm(), load="pull", configurations=COUNT, seed=5))
UNLOADED, LOADED = CAMPAIGN.position, CAMPAIGN.position + CAMPAIGN.deflection
SHUFFLED = np.random.default_rng(7).permutation(COUNT)
FIRST, _, THIRD, *_ = np.eye(6)
NOISE = 1e-5 * np.random.default_rng(8).standard_normal(UNLOADED.shape)


def causes(measurements):
    """Return code and message of the findings about the whole set."""
    findings = inspect_measurements(ROBOT, measurements, degrees=False)
    return [(each.code, each.message) for each in findings if each.where is None]


def read(unloaded, loaded):
    return replace(CAMPAIGN, position=unloaded, deflection=loaded - unloaded)


@pytest.mark.parametrize("count", [3, 1])
@pytest.mark.parametrize(
    ("order", "words"),
    [
        (np.roll(np.arange(COUNT), 1), "the row before"),
        (np.roll(np.arange(COUNT), -1), "the row after"),
        (np.roll(np.arange(COUNT), 4), "the row that is 4 rows before"),
        (SHUFFLED, "other rows"),
    ],
)
def test_loaded_readings_of_other_rows_are_named(order, words, count):
    measurements = read(UNLOADED, LOADED[order])
    (cause,) = causes(measurements if count == 3 else first_target(measurements))
    assert cause[0] == "observations_out_of_order"
    assert f"at the unloaded positions of {words}" in cause[1]


@pytest.mark.parametrize("count", [3, 1])
@pytest.mark.parametrize("order", [np.roll(np.arange(COUNT), 4), SHUFFLED])
def test_readings_in_another_order_than_the_angles_are_named(order, count):
    measurements = read(UNLOADED[order], LOADED[order])
    (cause,) = causes(measurements if count == 3 else first_target(measurements))
    assert cause[0] == "observations_out_of_order"
    assert "are in another order than the joint angles" in cause[1]


@pytest.mark.parametrize(
    ("order", "code"),
    [
        (np.roll(np.arange(500), 1), "observations_out_of_order"),
        (np.random.default_rng(7).permutation(500), "target_off_model"),
    ],
    ids=["shifted", "shuffled"],
)
def test_an_order_of_many_rows_is_searched_in_few_steps(order, code, monkeypatch):
    steps = []
    to_base = Postures.to_base

    def count(postures, places):
        steps.append(len(postures))
        return to_base(postures, places)

    robot, campaign = prepare(simulate_campaign(default_arm(), load="pull", configurations=500, seed=5))
    mixed = replace(campaign, position=campaign.position[order], deflection=campaign.deflection[order])
    monkeypatch.setattr(Postures, "to_base", count)
    findings = inspect_measurements(robot, mixed, degrees=False)
    assert code in {each.code for each in findings}
    assert sum(steps) <= 500_000  # a search of all rows with all rows alone takes 750,000


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_deflections_given_as_loaded_positions_are_named(sign):
    (cause,) = causes(read(UNLOADED, sign * CAMPAIGN.deflection))
    assert cause[0] == "deflection_implausibly_large"
    assert "the loaded readings seem to be deflections, loaded minus unloaded" in cause[1]


def test_a_set_without_any_load_is_named_once():
    unknown = replace(CAMPAIGN, force=np.zeros((COUNT, 3)), moment=np.zeros((COUNT, 3)))
    (finding,) = inspect_measurements(ROBOT, unknown, degrees=False)
    assert (finding.code, finding.weight) == ("zero_load", "do_not_use")
    assert finding.message.startswith(
        "no observation has a force or a moment, but the targets moved by up to"
    )


WRONG = {
    "readings of one posture under load": read(UNLOADED, LOADED[:1] + NOISE),
    "readings of one posture without load": read(UNLOADED[:1] + NOISE, LOADED),
    "a tracker that was moved": read(UNLOADED, LOADED + np.array([0.4, 0.0, 0.0])),
    "another frame under load": read(UNLOADED, LOADED[..., [1, 2, 0]]),
    "a wrong zero of joint 1": replace(CAMPAIGN, joints=CAMPAIGN.joints + 0.5 * FIRST),
    "a wrong zero of joint 3": replace(CAMPAIGN, joints=CAMPAIGN.joints + 0.2 * THIRD),
    "noise": read(UNLOADED[SHUFFLED] + 1e4 * NOISE, LOADED[SHUFFLED] + 1e4 * NOISE),
}


@pytest.mark.parametrize("measurements", WRONG.values(), ids=WRONG)
def test_other_mistakes_are_not_called_another_order(measurements):
    codes = {code for code, _ in causes(measurements)}
    assert "observations_out_of_order" not in codes


def shifted(state, step, first, target=1):
    """Return the campaign with the readings of one target in one state shifted from a row on."""
    states = {"unloaded": UNLOADED.copy(), "loaded": LOADED.copy()}
    given = states[state][:, target]
    given[first:] = np.roll(given, -step, axis=0)[first:]
    return read(**states)


@pytest.mark.parametrize("state", ["loaded", "unloaded"])
@pytest.mark.parametrize(("step", "side"), [(-1, "before"), (1, "after")])
@pytest.mark.parametrize("first", [0, 4, 11])
def test_readings_of_one_target_that_were_shifted_by_a_row_are_named_alone(state, step, side, first):
    measurements = shifted(state, step, first)
    name = measurements.targets[1]
    (finding,) = inspect_measurements(ROBOT, measurements, degrees=False)
    assert finding.code == "observations_out_of_order"
    other = {"loaded": "unloaded", "unloaded": "loaded"}[state]
    count = len(measurements) - first
    assert finding.message.startswith(
        f"the {state} readings of '{name}' of {count} of {len(measurements)} observations are at the {other} "
        f"positions of the row {side}"
    )
    assert finding.remedy.startswith(
        f"match the rows of the {state} readings of '{name}' with those of the others"
    )


def test_two_wrong_readings_or_a_target_that_moved_are_no_shifted_rows():
    moved = LOADED.copy()
    moved[5:, 1] += [0.1, 0.0, 0.0]
    bumped = Postures(ROBOT, ROBOT.joint_map.model_angles(CAMPAIGN.joints)).to_flange(LOADED)
    bumped[5:, 1] += [0.1, 0.0, 0.0]
    bumped = Postures(ROBOT, ROBOT.joint_map.model_angles(CAMPAIGN.joints)).to_base(bumped)
    for measurements in (shifted("loaded", -1, 13), read(UNLOADED, moved), read(UNLOADED, bumped), CAMPAIGN):
        codes = {each.code for each in inspect_measurements(ROBOT, measurements, degrees=False)}
        assert "observations_out_of_order" not in codes


def test_a_turned_frame_is_no_order_although_it_leads_from_posture_to_posture():
    """Postures on a ring about the axis of joint 1: turned by one step, each reading fits another row."""
    step = 2.0 * np.pi / 6.0
    joints = np.tile(CAMPAIGN.joints[3], (6, 1))
    joints[:, 0] = step * np.array([0, 3, 1, 5, 2, 4])
    turned = joints + step * FIRST
    places = np.broadcast_to([[0.1, 0.0, 0.2], [0.0, 0.1, 0.2], [-0.1, 0.0, 0.2]], (6, 3, 3))
    position = Postures(ROBOT, ROBOT.joint_map.model_angles(turned)).to_base(places)
    codes = {code for code, _ in causes(replace(CAMPAIGN[:6], joints=joints, position=position))}
    assert "observations_out_of_order" not in codes


def shifted_rows(step, forces_with_readings):
    """Return a set whose readings belong to the angles `step` rows after, and its rows that are complete."""
    order = np.clip(np.arange(COUNT) - step, 0, COUNT - 1)
    if forces_with_readings:
        return replace(CAMPAIGN, joints=CAMPAIGN.joints[order])
    order = np.clip(np.arange(COUNT) + step, 0, COUNT - 1)
    return replace(CAMPAIGN, position=UNLOADED[order], deflection=CAMPAIGN.deflection[order])


def find_order(measurements):
    """Return the only finding that the rows are in another order."""
    findings = inspect_measurements(ROBOT, measurements, degrees=False)
    (finding,) = [each for each in findings if each.code == "observations_out_of_order"]
    return finding


@pytest.mark.parametrize(("step", "way", "end"), [(1, "up", "last"), (-1, "down", "first")])
def test_forces_show_that_the_angles_are_shifted(step, way, end):
    given = shifted_rows(step, forces_with_readings=True)
    finding = find_order(given)
    assert finding.remedy.startswith(
        f"move the joint angles alone {way} by one row, and leave out the {end} "
    )
    kept = np.arange(COUNT - 1) if step > 0 else np.arange(1, COUNT)
    assert (
        inspect_measurements(ROBOT, replace(given[kept], joints=given.joints[kept + step]), degrees=False)
        == []
    )


@pytest.mark.parametrize(("step", "way", "end"), [(1, "down", "first"), (-1, "up", "last")])
def test_forces_show_that_the_readings_are_shifted(step, way, end):
    given = shifted_rows(step, forces_with_readings=False)
    finding = find_order(given)
    assert finding.remedy.startswith(f"move all readings {way} by one row, and leave out the {end} ")
    kept = np.arange(1, COUNT) if step > 0 else np.arange(COUNT - 1)
    readings = {"position": given.position[kept - step], "deflection": given.deflection[kept - step]}
    assert inspect_measurements(ROBOT, replace(given[kept], **readings), degrees=False) == []


def test_equal_forces_leave_open_which_side_is_shifted():
    given = shifted_rows(1, forces_with_readings=True)
    hanging = replace(given, force=np.tile([0.0, 0.0, -1500.0], (COUNT, 1)))
    finding = find_order(hanging)
    assert finding.remedy.startswith("shift the readings by one row")


def weigh(sizes):
    """Return a set under one hanging weight, whose stated forces have other sizes."""
    robot, campaign = prepare(
        simulate_campaign(default_arm(), load="dead_weight", configurations=COUNT, seed=5)
    )
    weight = np.linalg.norm(campaign.force, axis=1, keepdims=True)
    return inspect_measurements(
        robot, replace(campaign, force=campaign.force / weight * np.reshape(sizes, (-1, 1))), degrees=False
    )


@pytest.mark.parametrize("step", [9.80665, -9.80665, 20.0])
def test_forces_that_a_spreadsheet_filled_as_a_series_are_named(step):
    (finding,) = weigh(np.round(1500.0 + step * np.arange(COUNT), 2))
    assert "as a spreadsheet fills a column by dragging its first cell" in finding.message
    assert "write 1500 N in each" in finding.remedy
    assert weigh(np.full(COUNT, 1500.0)) == []


def test_weights_that_were_added_one_by_one_are_no_mistake():
    robot, campaign = prepare(
        simulate_campaign(default_arm(), load="dead_weight", configurations=COUNT, seed=5)
    )
    factor = np.linspace(1.0, 1.5, COUNT)[:, None]
    added = replace(
        campaign, force=campaign.force * factor, deflection=campaign.deflection * factor[..., None]
    )
    assert inspect_measurements(robot, added, degrees=False) == []
