"""Wrist centre, by trilateration as the paper has it and by other ways; drift of the base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support.examples import examples
from support.figures import length_in
from support.geometry_truth import HOME, SIGMA, TARGETS, Cell, chi_square, rodrigues

from jointstiff.simulator import default_arm
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.frames import BaseTargets, find_base_frame, find_wrist_centre, trilaterate
from jointstiff.solver.geometry.identification import drift_findings, wrist_findings
from jointstiff.solver.geometry.sweeps import identify_axes

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
    assert list(wrist_findings(wrist))


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
    return targets.drift(SIGMA, AT), targets


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
    (finding,) = drift_findings(found, targets)
    assert finding.code == "base_drifted"
    assert length_in(finding.message) == pytest.approx(np.linalg.norm(TURN @ AT + SHIFT - AT), abs=60e-6)


def test_one_base_target_that_moved_is_named_and_the_rest_is_no_drift_of_its_own():
    found, targets = drift(3, moved=False, off=4e-4)
    assert found.moved_targets == ["2"]
    assert "base_target_moved" in {finding.code for finding in drift_findings(found, targets)}
    assert found.deformation_probability < 1e-6


def test_targets_on_a_line_show_no_motion():
    line = np.linspace(0.0, 1.0, 4)[:, None] * np.ones(3)
    with pytest.raises(MeasurementError, match="line"):
        BaseTargets(line, line, np.eye(3), ("1", "2", "3", "4")).drift(SIGMA, AT)
