"""The meaning of tables by the robot: what is proposed, and what never is."""

from itertools import combinations

import numpy as np
import pytest
from support.measured_arms import PLACES, TRACKER, measure, wide

from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.solver.meaning.proposal import propose
from jointstiff.solver.meaning.screening import choose_subsets
from jointstiff.solver.meaning.table import RowGroups, Table
from jointstiff.solver.mechanics.postures import Postures


@pytest.fixture(scope="module")
def robots():
    return {known.name: known for known in catalogue_robots()}


def test_bare_columns_in_a_trackers_frame_get_joints_targets_and_unit(robots):
    known = robots["FANUC R-2000iC/165F"]
    joints, points = measure(known)
    tracker = (points - [2000.0, 500.0, 300.0]) @ TRACKER.T / 25.4
    best = propose([Table("day1.csv", wide(joints, tracker))], known.robot).best
    assert best.joints.columns == (0, 1, 2, 3, 4, 5)
    assert (best.joints.unit, best.unit, best.target_count) == ("deg", "in", 3)
    assert not best.is_in_base_frame
    np.testing.assert_allclose(best.frame.rotation, TRACKER.T, atol=5e-3)
    np.testing.assert_allclose([each.place for each in best.readings], PLACES, atol=5e-3)


def test_loaded_positions_are_a_second_state_of_their_target(robots):
    known = robots["KUKA KR 210 R2700 extra"]
    joints, points = measure(known)
    loaded = points - [0.0, 0.0, 0.8]
    best = propose(
        [Table("a", wide(joints, points[:, 0], loaded[:, 0], points[:, 1], loaded[:, 1]))], known.robot
    ).best
    assert [(each.target, each.state) for each in best.readings] == [(1, 0), (1, 1), (2, 0), (2, 1)]


@pytest.mark.parametrize("order", ["in turn", "in blocks"])
def test_a_list_of_points_is_matched_to_the_postures(robots, order):
    known = robots["ABB IRB 4600-60/2.05"]
    joints, points = measure(known)
    rows = points if order == "in turn" else points.transpose(1, 0, 2)
    best = propose([Table("j", joints), Table("p", rows.reshape(-1, 3))], known.robot).best
    assert {each.points.groups for each in best.readings} == {RowGroups(order, 3)}
    np.testing.assert_allclose([each.place for each in best.readings], PLACES, atol=5e-3)


def test_reversed_columns_are_found_with_residual_and_next_best(robots):
    known = robots["Yaskawa GP25"]
    joints, points = measure(known)
    best = propose([Table("a", wide(joints[:, ::-1], points[:, 0]))], known.robot).best
    assert best.joints.columns == (5, 4, 3, 2, 1, 0)
    assert (best.fitting, best.count, best.doubt) == (16, 16, "")
    assert best.next_residual > 4.0 * best.residual


def test_signs_that_may_be_exchanged_axes_are_a_question(robots):
    known = robots["ABB IRB 4600-60/2.05"]
    joints, points = measure(known)
    best = propose([Table("a", wide(joints * [-1, 1, 1, -1, 1, -1], points))], known.robot).best
    assert (
        best.doubt == "two of x, y and z may be exchanged instead of joints with J1, J4, J6 reversed, as KUKA"
    )


@pytest.mark.parametrize("arm", ["Universal Robots UR10e", "Stäubli TX2-60"])
@pytest.mark.parametrize("order", [[2, 1, 0], [1, 0, 2], [0, 2, 1]])
def test_exchanged_axes_of_an_arm_without_a_mirror_image_are_a_question(robots, arm, order):
    """Neither arm is its own mirror image, so that no other signs of joints fit."""
    joints, points = measure(robots[arm])
    loaded = points - [0.0, 0.3, 0.8]
    exchanged = np.stack([points, loaded], axis=2)[..., order]
    best = propose([Table("a", wide(joints, exchanged))], robots[arm].robot).best
    assert best.doubt == "two of x, y and z seem to be exchanged, or the sign of one of them is wrong"
    assert best.joints.counting.is_own
    read = [each.points.columns for each in best.readings]
    assert read == [tuple(first + np.array(order)) for first in range(6, 24, 3)]
    assert best.is_in_base_frame


def test_a_reversed_axis_of_a_tracker_is_a_question_with_a_right_handed_frame(robots):
    known = robots["Universal Robots UR5e"]
    joints, points = measure(known)
    tracker = (points - [2000.0, 500.0, 300.0]) @ TRACKER.T * [1, 1, -1]
    best = propose([Table("a", wide(joints, tracker))], known.robot).best
    assert best.doubt
    assert np.linalg.det(best.frame.rotation) == pytest.approx(1.0)
    columns = best.readings[0].points.columns
    read = best.frame.to_base(wide(joints, tracker)[:, list(columns)])
    np.testing.assert_allclose(read, 1e-3 * points[:, 0], atol=8e-3)


def test_any_two_damaged_rows_leave_a_subset_without_them():
    for count in (16, 17, 23, 48):
        subsets = [set(subset.tolist()) for subset in choose_subsets(count)]
        for damaged in combinations(range(count), 2):
            assert any(subset.isdisjoint(damaged) for subset in subsets)


NOTHING_RIGHT = {
    "rows rolled by one": lambda q, p: (q, np.roll(p, 1, axis=0)),
    "two joints exchanged": lambda q, p: (q[:, [0, 1, 2, 4, 3, 5]], p),
    "the sign of one joint": lambda q, p: (q * [1, 1, -1, 1, 1, 1], p),
    "lengths a tenth too long": lambda q, p: (q, 1.1 * p),
    "other joints": lambda q, p: (np.random.default_rng(3).uniform(-80, 80, q.shape), p),
    "targets at rest": lambda q, p: (q * [0, 0, 0, 1, 1, 1], p[:1] + 0.01 * (p - p[:1])),
}


@pytest.mark.parametrize("mistake", NOTHING_RIGHT)
@pytest.mark.parametrize("arm", ["FANUC R-2000iC/210F", "Universal Robots UR10e"])
def test_nothing_is_proposed_where_no_columns_are_right(robots, arm, mistake):
    joints, points = NOTHING_RIGHT[mistake](*measure(robots[arm]))
    answer = propose([Table("a", wide(joints, points))], robots[arm].robot)
    assert answer.best is None
    assert answer.reason


def place_exactly(known, joints):
    """Return the positions (N, 3) of the flange by the nominal model [mm]."""
    nominal = Postures(known.robot, known.robot.joint_map.model_angles(np.radians(joints)))
    return 1e3 * nominal.flange_translation


@pytest.mark.parametrize("decimals", [2, 3, 4, 16])
def test_positions_that_the_controller_computed_are_no_readings(robots, decimals):
    known = robots["Stäubli TX2-60"]
    joints, _ = measure(known)
    computed = np.round(place_exactly(known, joints), decimals)
    answer = propose([Table("a", wide(np.round(joints, decimals), computed))], known.robot)
    assert answer.best is None
    assert answer.reason == "the positions were computed from the joints, so that they are no readings"


@pytest.mark.parametrize("noise", [0.01, 0.02, 0.05, 0.1, 0.3])  # [mm]
def test_readings_of_an_arm_as_good_as_its_model_are_readings(robots, noise):
    """An arm that was calibrated differs from its model by noise alone, in the frame of a tracker, too."""
    known = robots["KUKA KR 210 R2700 extra"]
    joints = np.round(measure(known)[0], 2)  # as commanded
    exact = (place_exactly(known, joints) - [2000.0, 500.0, 300.0]) @ TRACKER.T
    generator = np.random.default_rng(5)
    first, second = (
        exact + shift + generator.normal(0.0, noise, exact.shape) for shift in (0.0, [0, 0, -0.5])
    )
    best = propose([Table("a", wide(joints, first, second))], known.robot).best
    assert [each.points.columns for each in best.readings] == [(6, 7, 8), (9, 10, 11)]
    assert [(each.target, each.state) for each in best.readings] == [(1, 0), (1, 1)]


@pytest.mark.parametrize("arm", ["KUKA KR 210 R2700 extra", "Yaskawa GP180", "ABB IRB 6640-185/2.8"])
def test_readings_in_r0_with_noise_as_small_as_the_rounding_of_joints_are_readings(robots, arm):
    known = robots[arm]
    joints = np.round(measure(known)[0], 3)
    exact = place_exactly(known, joints)
    generator = np.random.default_rng(7)
    first, second = (
        exact + shift + generator.normal(0.0, 0.02, exact.shape) for shift in (0.0, [0, 0, -0.5])
    )
    best = propose([Table("a", wide(joints, first, second))], known.robot).best
    assert [each.points.columns for each in best.readings] == [(6, 7, 8), (9, 10, 11)]


def test_too_few_postures_are_not_decided(robots):
    known = robots["Stäubli TX2-60"]
    joints, points = measure(known, postures=5)
    answer = propose([Table("a", wide(joints, points[:, 0]))], known.robot)
    assert answer.best is None


@pytest.mark.parametrize(
    ("factor", "is_accepted"), [(1.007, True), (0.994, True), (1.01, False), (0.99, False)]
)
def test_a_small_arm_may_differ_in_its_lengths_by_what_its_links_do(robots, factor, is_accepted):
    """Errors of links are some 0.6 mm whatever the arm: more than 0.6 % of an arm that reaches 0.5 m."""
    known = robots["Universal Robots UR3"]
    joints, points = measure(known)
    answer = propose([Table("a", wide(joints, factor * points))], known.robot)
    assert (answer.best is not None) == is_accepted
    if not is_accepted:
        assert answer.reason.startswith("the lengths of the robot differ by the factor ")


@pytest.mark.parametrize("damaged", [-9999.0, np.nan])
def test_damaged_rows_do_not_hide_the_meaning(robots, damaged):
    known = robots["KUKA KR 210 R2700 extra"]
    joints, points = measure(known)
    points[[3, 9]] = damaged
    best = propose([Table("a", wide(joints, points))], known.robot).best
    assert best.target_count == 3
    assert best.fitting == 42


def measure_with_load(known, sag):
    """Return joints, and positions of a target without and under load, of an arm as good as its model.

    `sag` is the greatest deflection [mm] under load.
    """
    joints, _ = measure(known)
    place = place_exactly(known, joints)
    shifts = np.outer(np.linspace(0.0, -sag, len(place)), [0.0, 0.0, 1.0])
    points = np.stack([place, place + shifts], axis=1)
    return joints, points + np.random.default_rng(4).normal(0.0, 0.08, points.shape)


def test_positions_that_a_load_moves_fit_beside_positions_that_fit_exactly(robots):
    known = robots["ABB IRB 6700-200/2.60"]
    joints, points = measure_with_load(known, sag=9.0)
    points[8, 1] = np.nan
    best = propose([Table("j", joints), Table("p", points.reshape(-1, 3))], known.robot).best
    assert [(each.target, each.state) for each in best.readings] == [(1, 0), (1, 1)]
    assert best.count == 31
    assert best.fitting == 31


def test_positions_that_half_fit_are_said_to_fit_in_part(robots):
    known = robots["ABB IRB 6700-200/2.60"]
    joints, points = measure_with_load(known, sag=0.0)
    points[10:] += np.random.default_rng(5).uniform(-400.0, 400.0, (6, 1, 3))
    answer = propose([Table("j", joints), Table("p", points.reshape(-1, 3))], known.robot)
    assert answer.best is None
    assert answer.reason.startswith("only 62% of the positions fit the robot (their median distance is 0.1")
