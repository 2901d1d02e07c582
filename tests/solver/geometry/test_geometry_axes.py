"""Axes, base frame, wrist centre and targets from sweeps: the shared data, and arms of our own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
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
from jointstiff.solver.geometry.charts import Axis, RigidTransform
from jointstiff.solver.geometry.findings import geometry_findings, wrist_findings
from jointstiff.solver.geometry.frames import find_base_frame, find_wrist_centre
from jointstiff.solver.geometry.identification import Conventions, IdentifiedGeometry, identify_from_sweeps
from jointstiff.solver.geometry.model import FlangeConvention, identify_model
from jointstiff.solver.geometry.sweeps import (
    SweepSet,
    SweptAxes,
    angle_probability,
    identify_axes,
    refine_axes,
)
from jointstiff.solver.robot.model import JointMap
from jointstiff.solver.robot.urdf import read_urdf

WAYS = ["one by one", "together", "together, controller's angles"]


def identified(sweeps: SweepSet, way: str) -> SweptAxes:
    angles = "controller" if way.endswith("angles") else "free"
    axes = identify_axes(sweeps, angles=angles)  # type: ignore[arg-type]
    return axes if way == "one by one" else refine_axes(axes, angles=angles)  # type: ignore[arg-type]


def within(error: np.ndarray, covariance: np.ndarray, most: float = 4.0) -> None:
    """Each component and the error as a whole, as unlikely as `most` standard uncertainties."""
    assert np.all(np.abs(error) <= most * np.sqrt(np.diag(covariance)))
    assert stats.chi2.sf(chi_square(error, covariance), len(error)) > 2 * stats.norm.sf(most)


@lru_cache
def shared(way: str) -> tuple[SweptAxes, dict[str, Any], np.ndarray, np.ndarray]:
    """Axes of the shared sweeps, their truth, and the base in the tracker's frame."""
    sweeps, truth = shared_sweeps()
    R, t = (np.array(truth["tracker_from_base"][key]) for key in ("rotation", "translation"))
    return identified(sweeps, way), truth, R, t


@pytest.mark.parametrize("way", WAYS)
class TestSharedSweeps:
    """Issue 5: all within 4 of their own standard uncertainties of truth.json."""

    def test_axes(self, way: str) -> None:
        found, truth, R, t = shared(way)
        for joint, axis in enumerate(truth["axes_at_zero"]):
            true = Axis.through(R @ axis["point"] + t, R @ axis["direction"])
            within(found.axes[joint].chart(true), axis_covariance(found, joint))

    @pytest.mark.parametrize("by", ["model", "axes"])
    def test_base_frame(self, way: str, by: str) -> None:
        found, _, R, t = shared(way)
        chain = shared_chain() if by == "model" else None
        transform = find_base_frame(found, chain, height=0.675).transform_tracker_to_base
        true = RigidTransform(R.T, -R.T @ t)
        within(transform.chart(true), transform.covariance)
        within(transform.inverse().chart(true.inverse()), transform.inverse().covariance)

    def test_wrist_centre(self, way: str) -> None:
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

    def test_targets(self, way: str) -> None:
        found, truth, *_ = shared(way)
        chain = shared_chain()
        base = find_base_frame(found, chain)
        model = identify_model(found, base, FlangeConvention.of_chain(chain), nominal=chain)
        true = np.array([truth["targets_in_flange"][name] for name in found.names])
        within((model.targets_in_flange - true).ravel(), model.targets_covariance)

    def test_nothing_is_flagged(self, way: str) -> None:
        found, *_ = shared(way)
        assert list(geometry_findings(found, found)) == []
        assert 0.85 < found.variance_factor < 1.15

    def test_sigma_from_the_residuals(self, way: str) -> None:
        sweeps, _ = shared_sweeps(stated=False)
        assert identified(sweeps, way).sigma == pytest.approx(SIGMA, rel=0.1)


def test_the_readings_say_whether_the_controllers_angles_are_good_enough() -> None:
    sweeps, _ = shared_sweeps()
    assert angle_probability(identify_axes(sweeps), identify_axes(sweeps, angles="controller")) > 0.01
    worse = []
    for one in sweeps.sweeps:
        error = np.outer(60e-6 * np.sin(12.0 * one.angles[:, one.joint]), np.eye(6)[one.joint])
        worse.append(replace(one, angles=one.angles + error))
    spoilt = replace(sweeps, sweeps=tuple(worse))
    assert angle_probability(identify_axes(spoilt), identify_axes(spoilt, angles="controller")) < 1e-6


def _worn(seed: int, *, spread: float) -> IdentifiedGeometry:
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
def test_gear_errors_and_sag_are_within_the_stated_uncertainties(spread: float, fit: str) -> None:
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
def test_readings_in_another_unit_are_refused(factor: float) -> None:
    sweeps = Cell().sweeps()
    with pytest.raises(MeasurementError) as caught:
        replace(sweeps, sweeps=tuple(replace(one, points=one.points * factor) for one in sweeps.sweeps))
    assert "units.length" in caught.value.remedy


@pytest.mark.parametrize("matrix", [np.eye(6), FANUC_MAP], ids=["own", "coupled"])
@pytest.mark.parametrize("way", WAYS)
def test_exact_sweeps_of_an_imperfect_arm_give_its_axes(matrix: np.ndarray, way: str) -> None:
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


def perpendicular_truth(cell: Cell) -> RigidTransform:
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
def test_a_coupled_sweep_states_its_uncertainty(way: str) -> None:
    """A FANUC arm: turning J2 moves the forearm without rotating it, circles of one radius."""
    cell = Cell(imperfect_arm(5), matrix=FANUC_MAP)
    squares = []
    for seed in range(16):
        found = identified(cell.sweeps(np.random.default_rng(seed)), way)
        squares.append(chi_squares(found, cell))
    # The mean of 16 χ² with four degrees of freedom scatters by 18 %: a third too small is seen.
    assert np.mean(squares, axis=0) == pytest.approx(np.full(6, 4.0), rel=0.6)


def test_against_each_other_the_controllers_joints_turn_one_axis() -> None:
    """J3 commanded against J2 keeps model joint 3 at rest; then the circles are ordinary ones."""
    cell = Cell(imperfect_arm(2), matrix=FANUC_MAP)
    angles = cell.sweeps().sweeps[1].angles.copy()
    angles[:, 2] = HOME[2] + HOME[1] - angles[:, 1]
    both = swept(cell, 1, angles)
    found = identify_axes(with_sweep(cell.sweeps(), 1, both))
    assert found.sweeps.turning(both) == (1,)
    assert np.abs(found.axes[1].chart(cell.axis_at(1, np.zeros(6)))).max() < 1e-8


def test_sweeps_at_different_homes_fit_together() -> None:
    cell, rng = Cell(imperfect_arm(9)), np.random.default_rng(4)
    homes = HOME + rng.uniform(-0.3, 0.3, (6, 6))
    parts = tuple(cell.sweeps(home=homes[joint]).sweeps[joint] for joint in range(6))
    found = identify_axes(replace(cell.sweeps(), sweeps=parts))
    assert np.abs(axis_errors(found, cell)).max() < 1e-8


def _single_axis() -> object:
    """There is nothing that it could agree with: it is fitted by itself."""
    read = Cell().sweeps(np.random.default_rng(0)).sweeps[0]
    one = SweepSet((replace(read, angles=read.angles[:, :1]),), NAMES, JointMap.identity(1), SIGMA)
    return identify_from_sweeps(one, Conventions("axes", "axes"))


def _coupled_at_another_home() -> object:
    cell = Cell(matrix=FANUC_MAP)
    moved = cell.sweeps(home=HOME + np.radians([5.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    return identify_axes(with_sweep(cell.sweeps(), 2, moved.sweeps[2]))


def _two_that_are_not_coupled() -> object:
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
def test_sweeps_that_determine_no_robot_are_refused(sweeps: Callable[[], object], message: str) -> None:
    with pytest.raises(MeasurementError, match=message):
        sweeps()


class TestBaseConvention:
    def test_without_a_model_x_points_to_axis_2_whatever_its_sense(self) -> None:
        arm, turn = default_arm(), np.where(np.arange(6) == 1, -1.0, 1.0)[:, None]
        for directions in (arm.axis_directions, turn * arm.axis_directions):
            cell = Cell(replace(arm, axis_directions=directions))
            found = identify_axes(cell.sweeps(np.random.default_rng(0)))
            base = find_base_frame(found, height=0.78)
            gap = base.transform_tracker_to_base.chart(cell.tracker_to_base)
            assert np.abs(gap).max() < 3e-4

    def test_parallel_first_axes_define_no_frame(self) -> None:
        arm = default_arm()
        directions = arm.axis_directions[[0, 0, 2, 3, 4, 5]]
        found = identify_axes(Cell(replace(arm, axis_directions=directions)).sweeps())
        with pytest.raises(MeasurementError, match="define the frame"):
            find_base_frame(found)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_regions_cover_as_they_say(way: str) -> None:
    """Issue 5: 500 sweep sets at 15 µm, 95 % regions cover 93 to 97 %; here over all axes of 150 sets."""
    cell, inside = Cell(imperfect_arm(8)), []
    for seed in range(150):
        found = identified(cell.sweeps(np.random.default_rng([seed, 5])), way)
        inside.append([square < stats.chi2.ppf(0.95, 4) for square in chi_squares(found, cell)])
    assert 0.93 < np.mean(inside) < 0.97
