"""Axes, base frame, wrist centre and targets from sweeps; the circle-point fit of one sweep."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy import stats
from support.figures import length_in
from support.geometry_truth import (
    FANUC_MAP,
    HOME,
    NAMES,
    SIGMA,
    TARGETS,
    Cell,
    axis_covariance,
    axis_errors,
    chi_square,
    chi_squares,
    imperfect_arm,
    nominal,
    shared_chain,
    shared_sweeps,
    swept,
    with_sweep,
)

from jointstiff.simulator import default_arm
from jointstiff.simulator.sweeps import SWEEPS, WornArm
from jointstiff.simulator.urdf import urdf_text
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.frames import find_base_frame, find_wrist_centre
from jointstiff.solver.geometry.identification import (
    Conventions,
    geometry_findings,
    identify_from_sweeps,
    sweep_findings,
    wrist_findings,
)
from jointstiff.solver.geometry.model import FlangeConvention, identify_model
from jointstiff.solver.geometry.poses import Axis, RigidTransform
from jointstiff.solver.geometry.sweeps import (
    SweepSet,
    angle_probability,
    fit_axis,
    identify_axes,
    refine_axes,
)
from jointstiff.solver.robot.model import JointMap
from jointstiff.solver.robot.urdf import read_urdf

WAYS = ["one by one", "together", "together, controller's angles"]


def identified(sweeps, way):
    angles = "controller" if way.endswith("angles") else "free"
    axes = identify_axes(sweeps, angles=angles)  # type: ignore[arg-type]
    return axes if way == "one by one" else refine_axes(axes, angles=angles)  # type: ignore[arg-type]


def within(error, covariance, most=4.0):
    """Each component and the error as a whole, as unlikely as `most` standard uncertainties."""
    assert np.all(np.abs(error) <= most * np.sqrt(np.diag(covariance)))
    assert stats.chi2.sf(chi_square(error, covariance), len(error)) > 2 * stats.norm.sf(most)


@lru_cache
def shared(way):
    """Axes of the shared sweeps, their truth, and the base in the tracker's frame."""
    sweeps, truth = shared_sweeps()
    R, t = (np.array(truth["tracker_from_base"][key]) for key in ("rotation", "translation"))
    return identified(sweeps, way), truth, R, t


@pytest.mark.parametrize("way", WAYS)
class TestSharedSweeps:
    """Issue 5: all within 4 of their own standard uncertainties of truth.json."""

    def test_axes(self, way):
        found, truth, R, t = shared(way)
        for joint, axis in enumerate(truth["axes_at_zero"]):
            true = Axis.through(R @ axis["point"] + t, R @ axis["direction"])
            within(found.axes[joint].chart(true), axis_covariance(found, joint))

    @pytest.mark.parametrize("by", ["model", "axes"])
    def test_base_frame(self, way, by):
        found, _, R, t = shared(way)
        chain = shared_chain() if by == "model" else None
        transform = find_base_frame(found, chain, height=0.675).transform_tracker_to_base
        true = RigidTransform(R.T, -R.T @ t)
        within(transform.chart(true), transform.covariance)
        within(transform.inverse().chart(true.inverse()), transform.inverse().covariance)

    def test_wrist_centre(self, way):
        """20 µm where the readings can do so, in the tracker's frame; in R0 the frame's part comes on top.

        Axis 2 fixes the direction of R0 within 20 µrad, which at 1 m from axis 1 are 20 µm: no estimator
        is better (Cramér-Rao bound of these readings: 6, 22 and 9 µm). Measured: 34, 23.2, 17.7 µm; it was
        20.3 together while the mean of the free angles was taken from the controller, which gears break.
        """
        found, truth, R, t = shared(way)
        base = find_base_frame(found, shared_chain())
        wrist = find_wrist_centre(found)
        true = np.array(truth["wrist_centre_in_base_at_home"])
        assert [estimate.way for estimate in wrist.estimates] == ["axes", "sphere", "trilateration"]
        for estimate in (*wrist.estimates, wrist.combined):
            within(estimate.centre - (R @ true + t), estimate.covariance)
            centre, covariance = wrist.in_base(estimate, base, found)
            within(centre - true, covariance)
            assert np.linalg.norm(estimate.centre - (R @ true + t)) < 20e-6
        assert list(wrist_findings(wrist)) == []
        assert wrist.miss_probability > 0.01
        centre, _ = wrist.in_base(wrist.combined, base, found)
        bound = dict(zip(WAYS, (40e-6, 24e-6, 20e-6), strict=True))
        assert np.linalg.norm(centre - true) < bound[way]

    def test_targets(self, way):
        found, truth, *_ = shared(way)
        chain = shared_chain()
        base = find_base_frame(found, chain)
        model = identify_model(found, base, FlangeConvention.of_chain(chain), nominal=chain)
        true = np.array([truth["targets_in_flange"][name] for name in found.names])
        within((model.targets_in_flange - true).ravel(), model.targets_covariance)

    def test_nothing_is_flagged(self, way):
        found, *_ = shared(way)
        assert list(geometry_findings(found, found)) == []
        assert 0.85 < found.variance_factor < 1.15

    def test_sigma_from_the_residuals(self, way):
        sweeps, _ = shared_sweeps(stated=False)
        assert identified(sweeps, way).sigma == pytest.approx(SIGMA, rel=0.1)


def test_the_readings_say_whether_the_controllers_angles_are_good_enough():
    sweeps, _ = shared_sweeps()
    assert angle_probability(identify_axes(sweeps), identify_axes(sweeps, angles="controller")) > 0.01
    worse = []
    for one in sweeps.sweeps:
        error = np.outer(60e-6 * np.sin(12.0 * one.angles[:, one.joint]), np.eye(6)[one.joint])
        worse.append(replace(one, angles=one.angles + error))
    spoilt = replace(sweeps, sweeps=tuple(worse))
    assert angle_probability(identify_axes(spoilt), identify_axes(spoilt, angles="controller")) < 1e-6


def _worn(seed, *, spread):
    """Identify an arm with gear errors and sag, swept from homes that differ by up to `spread` [rad]."""
    cell, rng = WornArm.random(seed, gear=60e-6, sag=30e-6), np.random.default_rng([seed, 9])
    parts = []
    for joint in range(6):
        home = HOME + rng.uniform(-spread, spread, 6)
        parts.append(swept(cell, joint, cell.sweep(joint, np.linspace(*SWEEPS[joint], 15), home), rng))
    sweeps = SweepSet(tuple(parts), NAMES, JointMap.identity(6), SIGMA)
    chain = read_urdf(urdf_text(cell.arm), "base_link", "flange")
    return identify_from_sweeps(sweeps, Conventions("nominal", "nominal"), nominal=chain)


@pytest.mark.parametrize(("spread", "fit"), [(0.0, "together"), (0.2, "one_by_one")])
def test_gear_errors_and_sag_are_within_the_stated_uncertainties(spread, fit):
    """Six sets, 8 lengths each: gears of 60 µrad move axes by 0.1 mm where a fit trusts them at rest.

    The links of the true chain stand for the nominal ones. Joints that rest elsewhere in each sweep make the
    sweeps disagree; then they are fitted one by one, and the uncertainties hold the gears' errors.
    """
    ratios = []
    for seed in range(6):
        found = _worn(seed, spread=spread)
        assert found.fit == fit
        assert "do_not_use" not in {finding.weight for finding in found.findings}
        assert ("sweeps_disagree" in {finding.code for finding in found.findings}) == (fit == "one_by_one")
        ratios += [link.difference / link.standard_uncertainty for link in found.links if link.unit == "m"]
    assert len(ratios) == 48
    assert np.abs(ratios).max() < 4.0
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.5


@pytest.mark.parametrize("factor", [1e3, 2e-3, 1e-3], ids=["mm as m", "barely", "m as mm"])
def test_readings_in_another_unit_are_refused(factor):
    sweeps = Cell().sweeps()
    with pytest.raises(MeasurementError) as caught:
        replace(sweeps, sweeps=tuple(replace(one, points=one.points * factor) for one in sweeps.sweeps))
    assert "units.length" in caught.value.remedy


@pytest.mark.parametrize("matrix", [np.eye(6), FANUC_MAP], ids=["own", "coupled"])
@pytest.mark.parametrize("way", WAYS)
def test_exact_sweeps_of_an_imperfect_arm_give_its_axes(matrix, way):
    """The true axes are not quite parallel, so that coupled sweeps do not quite translate."""
    cell = Cell(imperfect_arm(3), matrix=matrix)
    found = identified(cell.sweeps(), way)
    assert np.abs(axis_errors(found, cell)).max() < 1e-8
    posture = cell.arm.posture(np.zeros(6))
    at_zero = posture.targets_to_base(TARGETS) @ cell.rotation.T + cell.translation
    assert np.abs(found.targets - at_zero).max() < 1e-8
    base = find_base_frame(found, nominal())
    true = perpendicular_truth(cell)
    assert np.abs(base.transform_tracker_to_base.chart(true)).max() < 1e-8


def perpendicular_truth(cell):
    """Tracker to the base frame as the nominal arm has it: axis 1 is z, axis 2 at height 0.78 along y."""
    o, a = cell.arm.axis_points[1], cell.arm.axis_directions[1]
    x = np.cross(a, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    y = np.array([-x[1], x[0], 0.0])
    reach = -(o @ y) / (a @ y)  # along axis 2 to the foot of the common perpendicular
    height = (o + reach * a)[2]
    R = np.stack([x, y, [0.0, 0.0, 1.0]])
    return RigidTransform(R, np.array([0.0, 0.0, 0.78 - height])).after(cell.tracker_to_base)


@pytest.mark.parametrize("way", WAYS)
def test_a_coupled_sweep_states_its_uncertainty(way):
    """A FANUC arm: turning J2 moves the forearm without rotating it, circles of one radius."""
    cell = Cell(imperfect_arm(5), matrix=FANUC_MAP)
    squares = []
    for seed in range(16):
        found = identified(cell.sweeps(np.random.default_rng(seed)), way)
        squares.append(chi_squares(found, cell))
    # The mean of 16 χ² with four degrees of freedom scatters by 18 %: a third too small is seen.
    assert np.mean(squares, axis=0) == pytest.approx(np.full(6, 4.0), rel=0.6)


def test_against_each_other_the_controllers_joints_turn_one_axis():
    """J3 commanded against J2 keeps model joint 3 at rest; then the circles are ordinary ones."""
    cell = Cell(imperfect_arm(2), matrix=FANUC_MAP)
    angles = cell.sweeps().sweeps[1].angles.copy()
    angles[:, 2] = HOME[2] + HOME[1] - angles[:, 1]
    both = swept(cell, 1, angles)
    found = identify_axes(with_sweep(cell.sweeps(), 1, both))
    assert found.sweeps.turning(both) == (1,)
    assert np.abs(found.axes[1].chart(cell.axis_at(1, np.zeros(6)))).max() < 1e-8


def test_sweeps_at_different_homes_fit_together():
    cell, rng = Cell(imperfect_arm(9)), np.random.default_rng(4)
    homes = HOME + rng.uniform(-0.3, 0.3, (6, 6))
    parts = tuple(cell.sweeps(home=homes[joint]).sweeps[joint] for joint in range(6))
    found = identify_axes(replace(cell.sweeps(), sweeps=parts))
    assert np.abs(axis_errors(found, cell)).max() < 1e-8


def _single_axis():
    """There is nothing that it could agree with: it is fitted by itself."""
    read = Cell().sweeps(np.random.default_rng(0)).sweeps[0]
    one = SweepSet((replace(read, angles=read.angles[:, :1]),), NAMES, JointMap.identity(1), SIGMA)
    return identify_from_sweeps(one, Conventions("axes", "axes"))


def _coupled_at_another_home():
    cell = Cell(matrix=FANUC_MAP)
    moved = cell.sweeps(home=HOME + np.radians([5.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    return identify_axes(with_sweep(cell.sweeps(), 2, moved.sweeps[2]))


def _two_that_are_not_coupled():
    cell = Cell()
    angles = cell.sweeps().sweeps[1].angles.copy()
    angles[:, 2] += np.linspace(0.0, 0.3, len(angles))
    return identify_axes(with_sweep(cell.sweeps(), 1, swept(cell, 1, angles)))


@pytest.mark.parametrize(
    ("sweeps", "message"),
    [
        (_single_axis, "single axis"),
        (_coupled_at_another_home, "another configuration"),
        (lambda: identify_axes(with_sweep(Cell(matrix=FANUC_MAP).sweeps(), 2)), "model joint 3"),
        (_two_that_are_not_coupled, "model joints 2 and 3 turn in one sweep"),
        (lambda: identify_axes(with_sweep(with_sweep(Cell().sweeps(), 4), 3)), "model joint 4, 5"),
        (lambda: with_sweep(Cell().sweeps(), 5, Cell().sweeps().sweeps[0]), "2 sweeps turn model joint 1"),
    ],
)
def test_sweeps_that_determine_no_robot_are_refused(sweeps, message):
    with pytest.raises(MeasurementError, match=message):
        sweeps()


class TestBaseConvention:
    def test_without_a_model_x_points_to_axis_2_whatever_its_sense(self):
        arm, turn = default_arm(), np.where(np.arange(6) == 1, -1.0, 1.0)[:, None]
        for directions in (arm.axis_directions, turn * arm.axis_directions):
            cell = Cell(replace(arm, axis_directions=directions))
            found = identify_axes(cell.sweeps(np.random.default_rng(0)))
            base = find_base_frame(found, height=0.78)
            gap = base.transform_tracker_to_base.chart(cell.tracker_to_base)
            assert np.abs(gap).max() < 3e-4

    def test_parallel_first_axes_define_no_frame(self):
        arm = default_arm()
        directions = arm.axis_directions[[0, 0, 2, 3, 4, 5]]
        found = identify_axes(Cell(replace(arm, axis_directions=directions)).sweeps())
        with pytest.raises(MeasurementError, match="define the frame"):
            find_base_frame(found)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_regions_cover_as_they_say(way):
    """Issue 5: 500 sweep sets at 15 µm, 95 % regions cover 93 to 97 %; here over all axes of 150 sets."""
    cell, inside = Cell(imperfect_arm(8)), []
    for seed in range(150):
        found = identified(cell.sweeps(np.random.default_rng([seed, 5])), way)
        inside.append([square < stats.chi2.ppf(0.95, 4) for square in chi_squares(found, cell)])
    assert 0.93 < np.mean(inside) < 0.97


CELL = Cell(imperfect_arm(1))


def made(joint, low, high, count=15, cell=CELL, seed=0):
    """A sweep of one joint over an arc [degrees]."""
    angles = cell.sweep(joint, np.radians(np.linspace(low, high, count)))
    return swept(cell, joint, angles, None if seed is None else np.random.default_rng(seed))


def fitted(sweep, **options):
    options.setdefault("sigma", SIGMA)
    return fit_axis(sweep, sweep.angles[:, sweep.joint], **options)  # type: ignore[arg-type]


def error(fit, cell=CELL):
    return fit.axis.chart(cell.axis_at(fit.sweep.joint, HOME))


@pytest.mark.parametrize("angles", ["free", "controller"])
@pytest.mark.parametrize("joint", range(6))
def test_exact_readings_give_the_axis_to_rounding(joint, angles):
    fit = fitted(made(joint, -40.0, 50.0, seed=None), angles=angles)
    assert np.abs(error(fit)).max() < 1e-10
    assert np.abs(fit.residuals).max() < 1e-12
    assert fit.arc == pytest.approx(np.radians(90.0), abs=1e-9)
    posture = CELL.arm.posture(HOME)
    for t, target in enumerate(fit.targets(NAMES)):
        point = posture.point_to_base(TARGETS[t]) - posture.axis_points[joint]
        along = point @ posture.axis_directions[joint]
        assert target.radius == pytest.approx(np.sqrt(point @ point - along**2), abs=1e-9)


def test_missing_readings_and_a_target_that_was_read_once():
    exact = made(3, -60.0, 60.0, seed=None)
    present = np.random.default_rng(1).random(exact.present.shape) > 0.3
    present[:, 2] = False
    present[:, 0] |= ~present[:, 1]
    present[4] = True
    sweep = replace(exact, points=np.where(present[..., None], exact.points, np.nan), present=present)
    fit = fitted(sweep)
    assert np.abs(error(fit)).max() < 1e-9
    assert [target.readings for target in fit.targets(NAMES)] == present.sum(axis=0).tolist()


def test_the_covariance_is_that_of_many_repetitions():
    joint, found, stated = 2, [], []
    for seed in range(300):
        fit = fitted(made(joint, -40.0, 40.0, seed=seed))
        found.append(error(fit))
        stated.append(fit.axis_covariance)
    ratio = np.diag(np.cov(np.array(found).T)) / np.diag(np.mean(stated, axis=0))
    # the scatter of a variance from 300 draws is 8 %; frames of different fits agree to microradians
    assert np.all(np.abs(ratio - 1.0) < 0.3)
    inside = np.mean([chi_square(e, c) < stats.chi2.ppf(0.95, 4) for e, c in zip(found, stated, strict=True)])
    assert 0.91 < inside < 0.985


@pytest.mark.parametrize("joint", [3, 5])
def test_a_target_near_the_axis_does_not_spoil_it(joint):
    """Issue 5: one target 1.7 mm from axes 4 and 6; direction no worse than without that target.

    Axes 4 and 6 coincide at wrist angle zero, where one target can be near both.
    """
    posture = CELL.arm.posture(np.zeros(6))
    near = posture.axis_points[5] + posture.axis_directions[5] * -0.5
    side = np.cross(posture.axis_directions[5], [0.0, 0.0, 1.0])
    target = posture.flange_rotation.T @ (near + 1.7e-3 * side - posture.flange_translation)
    cell = Cell(CELL.arm, targets=np.vstack([TARGETS, target]))
    home = np.zeros(6)
    with_it, without = [], []
    angles = cell.sweep(joint, np.radians(np.linspace(-70.0, 70.0, 15)), home)
    for seed in range(30):
        sweep = swept(cell, joint, angles, np.random.default_rng(seed))
        all_four = fitted(sweep)
        three = fitted(replace(sweep, points=sweep.points[:, :3], present=sweep.present[:, :3]))
        if joint == 5:
            assert all_four.targets((*NAMES, "P13"))[3].radius < 2.2e-3
        for fit, errors in ((all_four, with_it), (three, without)):
            errors.append(fit.axis.chart(cell.axis_at(joint, home))[2:])
        assert np.all(
            np.linalg.eigvalsh(three.axis_covariance[2:, 2:] - all_four.axis_covariance[2:, 2:]) > -1e-16
        )
    assert np.mean(np.square(with_it)) < 1.05 * np.mean(np.square(without))


def test_weights_follow_the_trackers_noise():
    """Readings that are ten times worse along the line of sight than across, and worse far off."""
    exact = made(0, -50.0, 50.0, seed=None)
    distance = np.linalg.norm(exact.points, axis=-1, keepdims=True)
    sight = exact.points / distance
    shape = np.eye(3) + 99.0 * sight[..., :, None] * sight[..., None, :]
    covariance = shape * (distance[..., None] / 4.0) ** 2
    factors = np.linalg.cholesky(covariance)
    weighted, plain = [], []
    for seed in range(50):
        noise = np.random.default_rng(seed).normal(0.0, SIGMA, (*exact.points.shape, 1))
        points = exact.points + (factors @ noise)[..., 0]
        sweep = replace(exact, points=points, covariance=covariance)
        fit = fitted(sweep)
        weighted.append(chi_square(error(fit), fit.axis_covariance))
        e, f = error(fit), error(fitted(replace(exact, points=points)))
        plain.append((e @ e, f @ f))
    assert np.mean(weighted) == pytest.approx(4.0, rel=0.3)
    ours, unweighted = np.mean(plain, axis=0)
    assert ours < 0.8 * unweighted


def test_free_angles_survive_encoder_errors_that_ruin_the_others():
    """A gear that errs by 60 µrad once per 30° shifts a target at 1.4 m by 84 µm along its circle."""
    free, trusted = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        shown = np.radians(np.linspace(-40.0, 45.0, 15))
        real = shown + 60e-6 * np.sin(12.0 * shown + rng.uniform(0.0, 6.3))
        sweep = replace(swept(CELL, 1, CELL.sweep(1, real), rng), angles=CELL.sweep(1, shown))
        fit = fitted(sweep)
        free.append(chi_square(error(fit), fit.axis_covariance))
        assert np.sqrt(np.mean(fit.angle_deviation**2)) == pytest.approx(43e-6, rel=0.5)
        other = fitted(sweep, angles="controller")
        trusted.append(other.variance_factor)
    assert np.mean(free) == pytest.approx(4.0, rel=0.35)
    assert np.min(trusted) > 2.0


def codes(sweep, **options):
    return [finding.code for finding in sweep_findings(fitted(sweep, **options), NAMES)]


class TestFlags:
    def test_clean_sweeps_raise_nothing(self):
        for seed in range(48):
            assert codes(made(seed % 6, -45.0, 55.0, seed=seed)) == []

    def displaced(self, sweep, part, shift):
        """Findings where some readings are displaced by (3,) [m]."""
        points = sweep.points.copy()
        points[part] += shift
        return list(sweep_findings(fitted(replace(sweep, points=points)), NAMES))

    @pytest.mark.parametrize("joint", range(6))
    @pytest.mark.parametrize("at", [3, 8, 12])
    def test_a_bump_is_found_where_it_is(self, joint, at):
        shift = 2e-4 * np.array([0.6, -0.48, 0.64])
        first = self.displaced(made(joint, -60.0, 60.0), np.s_[at:], shift)[0]
        assert first.code == "tracker_bumped"
        assert first.where.endswith(f"position {at + 1}")
        assert 2e-5 < length_in(first.message) < 1e-3

    def test_one_reading_and_one_position_are_named(self):
        found = self.displaced(made(4, -60.0, 60.0), np.s_[6, 1], [2e-4, 0.0, 1e-4])
        (suspect,) = [finding for finding in found if finding.code == "reading_suspect"]
        assert suspect.where == "sweep of joint_5, position 7, target P11"
        assert length_in(suspect.message) == pytest.approx(2.2e-4, rel=0.4)
        found = self.displaced(made(2, -40.0, 60.0), 6, CELL.rotation @ [0.0, 4e-4, 0.0])
        assert found[0].code == "position_suspect"

    def test_a_short_arc_is_flagged_with_its_figure(self):
        (found,) = sweep_findings(fitted(made(2, 0.0, 20.0)), NAMES)
        assert found.code == "short_arc"
        assert "an arc of 20° determines" in found.message

    def test_a_wrong_sigma_is_flagged(self):
        sweep = made(2, -40.0, 60.0)
        assert codes(sweep, sigma=SIGMA / 3) == ["residuals_exceed_sigma"]
        assert codes(sweep, sigma=3 * SIGMA) == ["residuals_below_sigma"]
        assert codes(sweep, sigma=None) == []

    def test_angles_of_another_scale_are_flagged(self):
        sweep = made(2, -40.0, 60.0)
        wrong = sweep.angles.copy()
        wrong[:, 2] *= 1.1
        (found,) = sweep_findings(fitted(replace(sweep, angles=wrong)), NAMES)
        assert found.code == "angle_scale_suspect"
        assert f"turned {1 / 1.1:.4f} times as far" in found.message


@pytest.mark.parametrize(
    ("message", "change"),
    [
        ("3 positions", lambda s: {name: getattr(s, name)[:3] for name in ("angles", "points", "present")}),
        ("joint 3 turned", lambda _: {"joint": 1}),
        ("its angle changes by only 0°", lambda s: {"angles": s.angles[:1].repeat(len(s), axis=0)}),
        ("no target moved by more than 0 mm", lambda s: {"points": s.points[:1].repeat(len(s), axis=0)}),
        ("not finite", lambda s: {"points": np.where(s.points == s.points[3, 1, 0], np.nan, s.points)}),
        ("shape", lambda s: {"points": s.points[:, :2]}),
    ],
)
def test_readings_that_are_no_sweep_are_refused(message, change):
    sweep = made(2, -40.0, 60.0)
    with pytest.raises(MeasurementError, match=message):
        replace(sweep, **change(sweep))


def test_an_arc_too_short_is_refused():
    with pytest.raises(MeasurementError, match=r"arc of 4°"):
        SweepSet((made(2, 0.0, 4.0),), NAMES, JointMap.identity(6), SIGMA)
