"""Geometry: frames, tables of links, and the identified model."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats
from support.examples import examples
from support.geometry_truth import (
    FANUC_MAP,
    HOME,
    NAMES,
    SIGMA,
    TARGETS,
    Cell,
    axes_of_noisy_sweeps,
    axis_errors,
    chi_square,
    imperfect_arm,
    length_in,
    nominal,
    rodrigues,
)
from support.shared_data import MISSING, SHARED

from jointstiff.schemas.geometry import LinkComparison
from jointstiff.schemas.robot import DhRow
from jointstiff.simulator import default_arm
from jointstiff.simulator.sweeps import WornArm
from jointstiff.simulator.urdf import urdf_text
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.frames import (
    BaseTargets,
    FlangeConvention,
    NearlyParallel,
    build_dh_table,
    compare_links,
    find_base_frame,
    find_wrist_centre,
    identify_model,
    trilaterate,
)
from jointstiff.solver.geometry.identification import (
    Conventions,
    identify_from_poses,
    identify_from_sweeps,
    report_calibration,
    report_drift,
    report_vague_parameters,
    report_wrist_disagreement,
)
from jointstiff.solver.geometry.poses import Poses, PoseState, calibrate, transform_points
from jointstiff.solver.geometry.sweeps import identify_axes
from jointstiff.solver.mechanics.chain import ChainJoint, chain_dh_rows
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import JointMap, Robot
from jointstiff.solver.mechanics.urdf import read_urdf

ANGLES = np.random.default_rng(6).uniform(-np.pi, np.pi, (40, 6))


def flange_points(chain, angles, points):
    configurations = Postures(Robot(chain.model()), angles)
    turned = np.einsum("nij,tj->nti", configurations.flange_rotation, points)
    return turned + configurations.flange_translation[:, None]


def table_gap(table, chain, points=TARGETS):
    """How far off the chain's the table's points on the flange are, in all postures [m]."""
    base, tool = (pin.SE3(*map(np.array, dict(part).values())) for part in (table.base, table.tool))
    moved = flange_points(
        chain_dh_rows(table.rows, table.convention, "x"), ANGLES, transform_points(tool, points)
    )
    return transform_points(base, moved) - flange_points(chain, ANGLES, points)


@pytest.mark.parametrize("matrix", [np.eye(6), FANUC_MAP], ids=["own", "coupled"])
def test_the_model_predicts_what_the_tracker_reads_anywhere(matrix):
    cell = Cell(imperfect_arm(11), matrix=matrix)
    found = identify_axes(cell.sweeps())
    base = find_base_frame(found, nominal())
    model = identify_model(found, base, FlangeConvention.from_chain(nominal()), nominal=nominal())
    robot = Robot(model.chain.model(), JointMap(matrix, np.zeros(6)))
    angles = robot.joint_map.model_angles(ANGLES)
    predicted = flange_points(model.chain, angles, model.targets_in_flange)
    read = transform_points(base.transform_tracker_to_base, cell.readings(ANGLES))
    assert np.abs(predicted - read).max() < 1e-7
    assert model.chain.joint_names == nominal().joint_names
    assert model.chain.moving[2].limits == nominal().moving[2].limits


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("seed", range(4))
def test_dh_tables_are_exact_where_no_axes_are_nearly_parallel(seed, convention):
    rng = np.random.default_rng(seed)
    arm = imperfect_arm(seed)
    directions = arm.axis_directions + rng.normal(0.0, 0.3, (6, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    chain = read_urdf(urdf_text(replace(arm, axis_directions=directions)), "base_link", "flange")
    table, _ = build_dh_table(chain, convention, parallel_within=0.0)
    assert all(abs(row.d) < 100.0 for row in table.rows)
    assert np.abs(table_gap(table, chain)).max() < 1e-9
    assert table.deviation < 1e-12


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.4), (0.1, 1.5, 0.1), (0.0, np.pi / 2, 0.0)])
@pytest.mark.parametrize("parallel", ["joint_2", "joint_1"])
def test_dh_tables_are_exact_however_robot_and_tool_are_mounted(parallel, turn, convention):
    """Upright, or on a wall where x of R0 lies along axis 1; its parallel axes are apart, or one line."""
    joints, turned, z = list(nominal().joints), pin.exp3(np.array(turn)), np.array([0.0, 0.0, 1.0])
    if parallel == "joint_1":
        joints[1] = replace(joints[1], axis=z, translation=0.3 * z)
    mounts = [ChainJoint(name, "fixed", turned, 0.2 * z, z, None, name) for name in ("wall", "tool")]
    chain = replace(nominal(), flange="tool", joints=(mounts[0], *joints, mounts[1]))
    table, pairs = build_dh_table(chain, convention)
    assert np.abs(table_gap(table, chain)).max() < 1e-9
    assert table.deviation < 1e-12
    assert [(pair.joint, pair.made_parallel) for pair in pairs] == [(parallel, True)]


def test_table_numbers_that_run_away_and_links_that_are_vague_are_findings():
    pairs = [
        NearlyParallel(joint=f"joint_{i}", angle=angle, made_parallel=made)
        for i, angle, made in ((1, 4e-3, False), (2, 4e-3, True), (3, 0.02, False))
    ]
    numbers = {"nominal": 0.0, "identified": 0.0, "difference": 0.0}
    links = [
        LinkComparison(quantity=quantity, joint=f"joint_{i}", unit=unit, standard_uncertainty=u, **numbers)
        for quantity, i, unit, u in (("a", 1, "m", 0.0125), ("d", 2, "m", 9e-3), ("theta", 3, "rad", 0.0125))
    ]
    near, vague = report_vague_parameters(nominal().joint_names, "standard", pairs, links)
    assert (near.code, near.where) == ("axes_nearly_parallel", "dh.standard")
    assert near.message.startswith("the angle between axes 1 and 2 is 4 mrad")
    assert vague.message.endswith("determine a of joint 1 (u = 12 mm), theta of joint 3 (u = 0.72°)")
    assert len(list(report_vague_parameters(nominal().joint_names, "standard", pairs, links[1:2]))) == 1


@pytest.mark.parametrize("base", ["nominal", "axes"])
@pytest.mark.parametrize("flange", ["targets", "axes"])
def test_the_flange_stands_where_its_convention_says_with_a_nominal_model_or_none(flange, base):
    """And wherever that is, chain and targets give what the tracker reads in any posture."""
    cell, asked = Cell(imperfect_arm(5)), Conventions(base, flange)
    known = nominal() if base == "nominal" else None
    found = identify_from_sweeps(cell.sweeps(count=5), asked, nominal=known, fit="one_by_one")
    first, second, third = positions = np.array([target.position for target in found.targets])
    model, T = found.robot.model, found.transform_tracker_to_base
    predicted = flange_points(read_urdf(model.urdf, model.base, model.flange), ANGLES, positions)
    read = cell.readings(ANGLES) @ np.transpose(T.rotation) + T.translation
    assert np.abs(predicted - read).max() < 1e-7
    if flange == "targets":
        assert [*first, *second[1:], third[2]] == pytest.approx(np.zeros(6), abs=1e-8)
        assert second[0] > 0.0 < third[1]
    else:  # z along axis 6, from where it meets axis 5
        posture = cell.arm.posture(np.zeros(6))
        along = (posture.targets_to_base(TARGETS) - posture.axis_points[4]) @ posture.axis_directions[5]
        assert positions[:, 2] == pytest.approx(along, abs=5e-3)


class TestLinkTable:
    def table_of(self, found):
        base = find_base_frame(found, nominal())
        rows = compare_links(found, base, FlangeConvention.from_chain(nominal()), nominal())
        return {(row.quantity, row.joint): (row.difference, row.standard_uncertainty) for row in rows}

    @pytest.mark.parametrize("draws", [6, pytest.param(25, marks=pytest.mark.slow)])
    def test_its_uncertainties_are_true(self, draws):
        exact = self.table_of(identify_axes(Cell().sweeps()))
        squares = []
        for seed in range(draws):
            rows = self.table_of(axes_of_noisy_sweeps(seed))
            squares.append([((rows[key][0] - exact[key][0]) / rows[key][1]) ** 2 for key in exact])
        least, most = stats.chi2.ppf([1e-4, 1.0 - 1e-4], draws)
        total = np.sum(squares, axis=0)
        assert (total > least).all()
        assert (total < most).all()
        # A table has some 24 numbers of its own; their neighbours follow.
        assert np.mean(squares) == pytest.approx(1.0, abs=4.3 * np.sqrt(2.0 / 24.0 / draws))


LIMITS = default_arm().limits


def poses(cell, seed, *, count=30, sigma=0.0, still=None, stated=True):
    rng = np.random.default_rng([seed, 31])
    angles = 0.6 * rng.uniform(LIMITS[:, 0], LIMITS[:, 1], (count, 6)) @ np.linalg.inv(cell.matrix).T
    if still is not None:
        angles[:, still] = 0.3
    points = cell.readings(angles)
    points = points + rng.normal(0.0, sigma, points.shape) if sigma else points
    present = np.ones((count, len(cell.targets)), dtype=bool)
    joint_map = JointMap(cell.matrix, np.zeros(6))
    return Poses(angles, points, present, NAMES[: len(cell.targets)], joint_map, SIGMA if stated else None)


def worn(cell, count):
    rng = np.random.default_rng(5)
    angles = 0.6 * rng.uniform(LIMITS[:, 0], LIMITS[:, 1], (count, 6))
    points = cell.readings(angles) + rng.normal(0.0, SIGMA, (count, 3, 3))
    return Poses(angles, points, np.ones((count, 3), dtype=bool), NAMES, JointMap.identity(6), SIGMA)


@pytest.mark.parametrize(("seed", "matrix"), [(0, np.eye(6)), (1, FANUC_MAP)], ids=["own", "coupled"])
def test_exact_poses_give_the_arm(seed, matrix):
    tracker = rodrigues(np.random.default_rng(seed).normal(size=3), 2.5)
    cell = Cell(imperfect_arm(seed, 3e-3), rotation=tracker, matrix=matrix)
    found = calibrate(nominal(), poses(cell, seed))
    assert (found.evidence.determined, found.evidence.only_together) == (33, [])
    assert np.abs(axis_errors(found, cell)).max() < 1e-8
    base = find_base_frame(found, nominal())
    model = identify_model(found, base, FlangeConvention.from_chain(nominal()), nominal=nominal())
    assert model.targets_in_flange == pytest.approx(TARGETS, abs=0.02)


def test_the_error_of_poses_left_out_is_that_of_poses_never_shown():
    """Gears of 60 µrad, which no geometry explains: the residuals alone flatter the fit."""
    cell = replace(WornArm.random(3, gear=60e-6, sag=30e-6), turns=np.full(6, 24.0))
    both = worn(cell, 120)
    shown, never_shown = both[np.arange(120) < 20], both[np.arange(120) >= 20]
    found = calibrate(read_urdf(urdf_text(cell.arm), "base_link", "flange"), shown)
    state = PoseState(found.axes, found.targets, np.zeros(100))
    errors = never_shown.points - state.motion(never_shown.whitened).points
    assert found.evidence.held_out_rms == pytest.approx(np.sqrt(np.square(errors).mean()), rel=0.3)
    assert found.evidence.held_out_rms > 1.3 * found.evidence.rms_residual


@pytest.mark.parametrize("seed", [5, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_parts_whose_fit_stalls_at_the_residual_of_all_poses_have_converged(seed):
    """Joint 6 hardly turned: noise leaves a flat valley along its axis, where four parts of five stall."""
    cell = Cell(imperfect_arm(seed, 3e-3), targets=TARGETS[:1])
    read = poses(cell, seed)
    angles = read.angles.copy()
    angles[:, 5] = 0.3 + 3e-3 * (angles[:, 5] - angles[:, 5].mean())
    noise = np.random.default_rng(seed).normal(0.0, SIGMA, read.points.shape)
    found = calibrate(nominal(), replace(read, angles=angles, points=cell.readings(angles) + noise))
    assert found.evidence.rms_residual < found.evidence.held_out_rms < 4 * SIGMA


def test_covariances_of_each_reading_go_with_their_poses():
    read = poses(Cell(), 3, count=12, sigma=SIGMA)
    each = replace(read, covariance=np.tile(np.eye(3), (12, 3, 1, 1)))
    alike, found = (calibrate(nominal(), one).evidence.held_out_rms for one in (read, each))
    assert SIGMA < found == pytest.approx(alike, rel=1e-6)


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.is_dir(), reason=MISSING)
def test_a_real_arm_has_an_error_of_poses_left_out():
    """1,000 poses of a UR5, its target nearly on axis 6: two of five parts stall at 65 µm."""
    file = SHARED / "ur5_grid" / "3D_UR5_uncalibrated_grid_cleaned.csv"
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    points = 1e-3 * (rows[:, 1:4] + rows[:, 4:7])[:, None]
    present = np.ones((len(rows), 1), dtype=bool)
    read = Poses(np.radians(rows[:, 7:13]), points, present, ("tool",), JointMap.identity(6))
    links = (
        (0.0, np.pi / 2, 0.089159),
        (-0.425, 0.0, 0.0),
        (-0.39225, 0.0, 0.0),
        (0.0, np.pi / 2, 0.10915),
        (0.0, -np.pi / 2, 0.09465),
        (0.0, 0.0, 0.0823),
    )
    arm = chain_dh_rows([DhRow(a=a, alpha=alpha, d=d, theta=0.0) for a, alpha, d in links], "standard", "UR5")
    found = calibrate(arm, read)
    assert found.evidence.held_out_rms == pytest.approx(65.0e-6, rel=0.01)
    assert found.evidence.held_out_rms > found.evidence.rms_residual


def test_too_few_poses_have_no_error_of_poses_left_out():
    assert calibrate(nominal(), poses(Cell(), 1, count=4, sigma=SIGMA)).evidence.held_out_rms is None


@pytest.mark.parametrize("draws", [8, pytest.param(30, marks=pytest.mark.slow)])
def test_uncertainties_are_true(draws):
    cell, squares = Cell(imperfect_arm(4)), []
    for seed in range(draws):
        found = calibrate(nominal(), poses(cell, seed, sigma=SIGMA))
        squares.append(chi_square(axis_errors(found, cell).ravel(), found.covariance[:24, :24]))
        assert 0.7 < found.variance_factor < 1.4
    assert np.mean(squares) == pytest.approx(24.0, abs=4.0 * np.sqrt(48.0 / draws))


def test_a_joint_that_never_turned_is_named_and_its_numbers_have_no_uncertainty():
    found = calibrate(nominal(), poses(Cell(), 2, sigma=SIGMA, still=3))
    assert found.evidence.determined == 33 - 4
    assert len(found.evidence.only_together) == 4
    assert all(any(name.startswith("axis 4") for name in names) for names in found.evidence.only_together)
    named = {name for names in found.evidence.only_together for name in names}
    assert not any(name.startswith(("axis 1", "axis 2", "axis 3")) for name in named), "these are known"
    assert {finding.code for finding in report_calibration(found)} == {"parameters_not_identified"}
    assert all("determine a combination of" in finding.message for finding in report_calibration(found))
    base = find_base_frame(found, nominal())
    rows = compare_links(found, base, FlangeConvention.from_chain(nominal()), nominal())
    by_key = {(row.quantity, row.joint): row.standard_uncertainty for row in rows}
    assert by_key["alpha", "joint_3"] is by_key["a", "joint_4"] is None
    assert by_key["a", "joint_2"] < 100e-6
    one = np.eye(len(found.covariance))
    several = replace(found, covariance=one, undetermined=np.column_stack([1e3 * one[0], 1e-2 * one[5]]))
    rows = np.stack([one[0], one[5], one[1], one[1] + 1e-8 * one[0]])
    assert several.compute_standard_uncertainties(rows).tolist() == [np.inf, np.inf, 1.0, 1.0]


def test_gear_errors_in_poses_widen_the_uncertainties_and_are_said():
    """Gears of 60 µrad leave 0.1 mm where 15 µm are stated; lengths stay within what is then said of them.

    They have 24 periods a turn or more: what is as smooth as a length's effect, no pose tells from it.
    """
    turns = np.array([24.0, 31.0, 37.0, 40.0, 29.0, 50.0])
    cell = replace(WornArm.random(3, gear=60e-6, sag=30e-6), turns=turns)
    truth = read_urdf(urdf_text(cell.arm), "base_link", "flange")
    found = identify_from_poses(worn(cell, 60), Conventions("nominal", "nominal"), nominal=truth)
    assert "residuals_exceed_sigma" in {finding.code for finding in found.findings}
    assert found.sigma_source == "residuals"
    assert found.sigma > 2 * SIGMA
    ratios = [link.difference / link.standard_uncertainty for link in found.links if link.unit == "m"]
    assert np.abs(ratios).max() < 4.0


coordinates = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


def true_centre(cell):
    posture = cell.arm.posture(cell.matrix @ HOME)
    return cell.rotation @ posture.axis_points[4] + cell.translation


@examples(100)
@given(coordinates, coordinates, coordinates, coordinates)
def test_trilateration_finds_the_point_and_its_mirror_image(p, q, r, c):
    targets, centre = np.array([p, q, r]), np.array(c)
    normal = np.cross(targets[1] - targets[0], targets[2] - targets[0])
    longest = max(np.linalg.norm(targets - np.roll(targets, 1, axis=0), axis=1))
    assume(np.linalg.norm(normal) > 0.05 * longest**2 and longest > 0.05)
    unit = normal / np.linalg.norm(normal)
    assume(abs((centre - targets[0]) @ unit) > 0.05)
    distances = np.linalg.norm(targets - centre, axis=1)
    assert trilaterate(targets, distances, centre + 0.01)[0] == pytest.approx(centre, abs=1e-9)
    mirrored = centre - 2.0 * ((centre - targets[0]) @ unit) * unit
    assert trilaterate(targets, distances, mirrored)[0] == pytest.approx(mirrored, abs=1e-9)


@pytest.mark.parametrize(
    ("targets", "distances"),
    [
        ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [1.0, 1.0, 1.0]),
        ([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [1.0, 1.0, 1.0]),
        ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [0.1, 0.1, 0.1]),
    ],
)
def test_impossible_trilaterations_are_refused(targets, distances):
    with pytest.raises(MeasurementError):
        trilaterate(np.array(targets), distances, [0.0, 0.0, 1.0])


def test_an_ill_conditioned_way_counts_little():
    """Targets in the plane of the wrist centre: trilateration then says nothing across that plane."""
    arm = default_arm()
    posture = arm.posture(np.zeros(6))
    centre = posture.flange_rotation.T @ (posture.axis_points[4] - posture.flange_translation)
    plane = centre + np.array([[0.3, 0.0, 0.004], [-0.1, 0.25, 0.0], [-0.15, -0.2, -0.003]])
    cell = Cell(arm, targets=plane)
    found = identify_axes(cell.sweeps(np.random.default_rng(1)))
    wrist = find_wrist_centre(found, find_base_frame(found))
    weights = {estimate.way: estimate.weight for estimate in wrist.estimates}
    assert weights["trilateration"] < 0.5 * (weights["axes"] + weights["sphere"])
    error = wrist.combined.tracker - true_centre(cell)
    assert chi_square(error, np.array(wrist.combined.tracker_covariance)) < 16.0
    assert np.linalg.norm(error) < 20e-6


def test_wrist_axes_that_do_not_meet_are_measured():
    for offset in (0.1e-3, 1e-3):
        cell = Cell(default_arm(wrist_offset=offset))
        found = identify_axes(cell.sweeps(np.random.default_rng(2)))
        wrist = find_wrist_centre(found, find_base_frame(found))
        # the nearest point lies between: axis 6 is off axes 4 and 5, which meet
        assert 0.4 * offset < wrist.miss_distance < offset
        assert wrist.miss_probability < 1e-6
        assert wrist.miss_uncertainty < 20e-6
    assert list(report_wrist_disagreement(wrist))


def test_trilateration_is_by_the_three_targets_of_the_largest_triangle():
    """The first three of four lie on a line."""
    line = TARGETS[0] + np.outer([0.0, 0.5, 1.0], TARGETS[1] - TARGETS[0])
    cell = Cell(targets=np.vstack([line, TARGETS[2]]))
    found = identify_axes(cell.sweeps())
    wrist = find_wrist_centre(found, find_base_frame(found))
    (by_three,) = (estimate for estimate in wrist.estimates if estimate.way == "trilateration")
    assert by_three.tracker == pytest.approx(true_centre(cell), abs=1e-8)


def test_a_single_wrist_sweep_leaves_the_axes_alone():
    """Sweeps of the wrist with the arm elsewhere share no sphere."""
    cell = Cell()
    sweeps = cell.sweeps()
    elsewhere = cell.sweeps(home=HOME + np.radians([0.0, 8.0, 0.0, 0.0, 0.0, 0.0]))
    parts = (*sweeps.sweeps[:3], elsewhere.sweeps[3], elsewhere.sweeps[4], sweeps.sweeps[5])
    found = identify_axes(replace(sweeps, sweeps=parts))
    wrist = find_wrist_centre(found, find_base_frame(found))
    assert [estimate.way for estimate in wrist.estimates] == ["axes"]
    assert wrist.combined.tracker == pytest.approx(true_centre(cell), abs=1e-8)


BASE = np.array([[0.6, 0.4, 0.1], [-0.5, 0.5, 0.05], [-0.4, -0.6, 0.2], [0.5, -0.5, 0.12], [0.0, 0.7, 0.6]])
AT = np.array([1.2, 0.3, 1.5])
TURN = rodrigues(np.array([0.3, -0.5, 0.8]), 60e-6)
SHIFT = np.array([40e-6, -30e-6, 80e-6])


def drift(seed, *, moved, off=0.0, along=2, count=5):
    rng = np.random.default_rng(seed)
    after = BASE[:count] @ TURN.T + SHIFT if moved else BASE[:count].copy()
    after[1, along] += off
    before, after = (points + rng.normal(0.0, SIGMA, points.shape) for points in (BASE[:count], after))
    names = tuple(str(number + 1) for number in range(count))
    targets = BaseTargets(before, after, np.eye(3), names)
    return targets.fit_drift(SIGMA, AT), targets


def test_a_drift_is_found_with_its_figure_and_can_be_removed():
    squares = []
    for seed in range(200):
        found, targets = drift(seed, moved=True)
        assert found.significant
        error = found.displacement - (TURN @ AT + SHIFT - AT)
        covariance, back = np.array(found.displacement_covariance), found.transform_after_to_before
        squares.append(chi_square(error, covariance))
        point = np.array(back.rotation) @ (TURN @ AT + SHIFT) + back.translation
        assert chi_square(point - AT, covariance) < 30.0
    assert np.mean(squares) == pytest.approx(3.0, rel=0.25)
    (finding,) = report_drift(found, targets)
    assert finding.code == "base_drifted"
    assert length_in(finding.message) == pytest.approx(np.linalg.norm(TURN @ AT + SHIFT - AT), abs=60e-6)


def test_a_base_that_stands_still_did_not_move():
    chances = [drift(seed, moved=False)[0].probability for seed in range(40)]
    assert stats.kstest(chances, "uniform").pvalue > 1e-3
    found = BaseTargets(BASE, BASE.copy(), np.eye(3), tuple("12345")).fit_drift(SIGMA, AT)
    assert (found.probability, found.significant, found.moved_targets) == (pytest.approx(1.0), False, [])
    line = np.array([[1.0, 0.0, 0.0], [1.4, 0.8, 0.2], [2.0, 2.0, 0.5]])
    with pytest.raises(MeasurementError, match="on a line"):
        BaseTargets(line, line, np.eye(3), ("1", "2", "3")).fit_drift(SIGMA, AT)


def test_one_base_target_that_moved_is_named_and_the_rest_is_no_drift_of_its_own():
    found, targets = drift(3, moved=False, off=4e-4)
    assert found.moved_targets == ["2"]
    assert "base_target_moved" in {finding.code for finding in report_drift(found, targets)}
    assert found.deformation_probability < 1e-6
