"""Axes, base frame, wrist centre and targets from sweeps; the circle-point fit of one sweep."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pinocchio as pin
import pytest
from scipy import stats
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
    length_in,
    nominal,
    shared_chain,
    shared_sweeps,
    swept,
    with_sweep,
)

from jointstiff.simulator.sweeps import SWEEPS, WornArm
from jointstiff.simulator.urdf import urdf_text
from jointstiff.solver.geometry.frames import find_base_frame, find_wrist_centre
from jointstiff.solver.geometry.identification import (
    Conventions,
    identify_from_sweeps,
    report_sweep,
    report_sweeps,
    report_wrist_disagreement,
)
from jointstiff.solver.geometry.poses import Axis
from jointstiff.solver.geometry.sweeps import SweepSet, fit_axis, identify_axes, refine_axes
from jointstiff.solver.mechanics.robot import JointMap
from jointstiff.solver.mechanics.urdf import read_urdf

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

    def test_wrist_centre(self, way):
        """20 µm where the readings can do so, in the tracker's frame; in R0 the frame's part comes on top.

        Axis 2 fixes the direction of R0 within 20 µrad, which at 1 m from axis 1 are 20 µm: no estimator
        is better (Cramér-Rao bound of these readings: 6, 22 and 9 µm). Measured: 34, 23.2, 17.7 µm; it was
        20.3 together while the mean of the free angles was taken from the controller, which gears break.
        """
        found, truth, R, t = shared(way)
        base = find_base_frame(found, shared_chain())
        wrist = find_wrist_centre(found, base)
        true = np.array(truth["wrist_centre_in_base_at_home"])
        assert [estimate.way for estimate in wrist.estimates] == ["axes", "sphere", "trilateration"]
        for estimate in (*wrist.estimates, wrist.combined):
            within(estimate.tracker - (R @ true + t), np.array(estimate.tracker_covariance))
            within(estimate.base - true, np.array(estimate.base_covariance))
            assert np.linalg.norm(estimate.tracker - (R @ true + t)) < 20e-6
        assert list(report_wrist_disagreement(wrist)) == []
        assert wrist.miss_probability > 0.01
        bound = dict(zip(WAYS, (40e-6, 24e-6, 20e-6), strict=True))
        assert np.linalg.norm(wrist.combined.base - true) < bound[way]

    def test_nothing_is_flagged(self, way):
        found, *_ = shared(way)
        assert list(report_sweeps(found, found)) == []
        assert 0.85 < found.variance_factor < 1.15

    def test_sigma_from_the_residuals(self, way):
        sweeps, _ = shared_sweeps(stated=False)
        assert identified(sweeps, way).sigma == pytest.approx(SIGMA, rel=0.1)


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


@pytest.mark.parametrize("sets", [1, pytest.param(6, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("spread", "fit"), [(0.0, "together"), (0.2, "one_by_one")])
def test_gear_errors_and_sag_are_within_the_stated_uncertainties(spread, fit, sets):
    """Sets with 8 lengths each: gears of 60 µrad move axes by 0.1 mm where a fit trusts them at rest.

    The links of the true chain stand for the nominal ones. Joints that rest elsewhere in each sweep make the
    sweeps disagree; then they are fitted one by one, and the uncertainties hold the gears' errors.
    """
    ratios = []
    for seed in range(sets):
        found = _worn(seed, spread=spread)
        assert found.fit == fit
        assert "do_not_use" not in {finding.weight for finding in found.findings}
        assert ("sweeps_disagree" in {finding.code for finding in found.findings}) == (fit == "one_by_one")
        ratios += [link.difference / link.standard_uncertainty for link in found.links if link.unit == "m"]
    assert len(ratios) == 8 * sets
    assert np.abs(ratios).max() < 4.0
    least, most = stats.chi2.ppf([1e-4, 1.0 - 1e-4], 8 * sets)
    assert least < np.square(ratios).sum() < most


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
    assert np.abs(pin.log6(base.transform_tracker_to_base.actInv(true)).vector).max() < 1e-8


def test_covariances_of_coupled_axes_are_those_of_fits_to_displaced_readings():
    """Each coordinate is displaced both ways and fitted anew: no derivative of the solver's is in that.

    Of joints 2 and 3 alone: what the sweep of joint 3 leaves open goes on into axis 2.
    """
    two = slice(1, 3)
    whole = Cell(imperfect_arm(3), matrix=FANUC_MAP, targets=TARGETS[:2]).sweeps(count=4)
    parts = tuple(
        replace(part, angles=part.angles[:, two], joint=joint) for joint, part in enumerate(whole.sweeps[two])
    )
    sweeps = SweepSet(parts, NAMES[:2], JointMap(FANUC_MAP[two, two], np.zeros(2)), SIGMA)
    found = identify_axes(sweeps)

    def charts(sign, joint, at):
        points = parts[joint].points.copy()
        points[at] += sign * 1e-6
        moved = identify_axes(with_sweep(sweeps, joint, replace(parts[joint], points=points)))
        as_swept = found.fits[0].axis.chart(moved.fits[0].axis)
        return np.hstack([as_swept, *(axis.chart(m) for axis, m in zip(found.axes, moved.axes, strict=True))])

    places = [(joint, at) for joint in range(2) for at in np.ndindex(parts[joint].points.shape)]
    by_readings = np.transpose([charts(1, *place) - charts(-1, *place) for place in places]) / 2e-6
    for rows, stated in (
        (by_readings[:4], found.fits[0].axis_covariance),
        (by_readings[4:], found.covariance[:8, :8]),
    ):
        expected = SIGMA**2 * rows @ rows.T
        u = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(stated / np.outer(u, u), expected / np.outer(u, u), rtol=0.0, atol=1e-6)


def perpendicular_truth(cell):
    """Tracker to the base frame as the nominal arm has it: axis 1 is z, axis 2 at height 0.78 along y."""
    o, a = cell.arm.axis_points[1], cell.arm.axis_directions[1]
    x = np.cross(a, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    y = np.array([-x[1], x[0], 0.0])
    reach = -(o @ y) / (a @ y)  # along axis 2 to the foot of the common perpendicular
    height = (o + reach * a)[2]
    R = np.stack([x, y, [0.0, 0.0, 1.0]])
    return pin.SE3(R, np.array([0.0, 0.0, 0.78 - height])) * cell.tracker_to_base


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_regions_cover_as_they_say(way):
    """500 sweep sets at 15 µm: 95 % regions cover 93 to 97 %."""
    cell, inside = Cell(imperfect_arm(8)), []
    for seed in range(500):
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
    radii = np.linalg.norm((fit.target_points - fit.axis.point) @ fit.axis.frame[:, :2], axis=1)
    for radius, target in zip(radii, TARGETS, strict=True):
        point = posture.point_to_base(target) - posture.axis_points[joint]
        along = point @ posture.axis_directions[joint]
        assert radius == pytest.approx(np.sqrt(point @ point - along**2), abs=1e-9)
    radial, axial = fit.compute_residual_rms()
    assert [*radial, *axial] == pytest.approx([0.0] * 6, abs=1e-12)


@pytest.mark.parametrize("draws", [80, pytest.param(300, marks=pytest.mark.slow)])
def test_the_covariance_is_that_of_many_repetitions(draws):
    joint, found, stated = 2, [], []
    for seed in range(draws):
        fit = fitted(made(joint, -40.0, 40.0, seed=seed))
        found.append(error(fit))
        stated.append(fit.axis_covariance)
    ratio = np.diag(np.cov(np.array(found).T)) / np.diag(np.mean(stated, axis=0))
    # frames of different fits agree to microradians
    assert np.all(np.abs(ratio - 1.0) < 3.7 * np.sqrt(2.0 / draws))
    inside = np.mean([chi_square(e, c) < stats.chi2.ppf(0.95, 4) for e, c in zip(found, stated, strict=True)])
    assert abs(inside - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / draws)


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


class TestFlags:
    def displaced(self, sweep, part, shift):
        """Findings where some readings are displaced by (3,) [m]."""
        points = sweep.points.copy()
        points[part] += shift
        return list(report_sweep(fitted(replace(sweep, points=points)), NAMES))

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
