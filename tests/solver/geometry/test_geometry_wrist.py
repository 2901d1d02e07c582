"""Trilateration against the paper, and the ways to the wrist centre against each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support.examples import examples
from support.geometry_truth import HOME, SIGMA, Cell, axes_of_noisy_sweeps, chi_square, imperfect_arm

from jointstiff.simulator import default_arm
from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.frames.sphere_fit import trilaterate
from jointstiff.solver.geometry.frames.wrist_centre import find_wrist_centre
from jointstiff.solver.geometry.sweeps.swept_axes import identify_axes

coordinates = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


def true_centre(cell: Cell) -> np.ndarray:
    posture = cell.arm.posture(cell.matrix @ HOME)
    return cell.rotation @ posture.axis_points[4] + cell.translation


@examples(100)
@given(coordinates, coordinates, coordinates, coordinates)
def test_trilateration_finds_the_point_and_its_mirror_image(
    p: tuple[float, ...], q: tuple[float, ...], r: tuple[float, ...], c: tuple[float, ...]
) -> None:
    targets, centre = np.array([p, q, r]), np.array(c)
    normal = np.cross(targets[1] - targets[0], targets[2] - targets[0])
    longest = max(np.linalg.norm(targets - np.roll(targets, 1, axis=0), axis=1))
    assume(np.linalg.norm(normal) > 0.05 * longest**2 and longest > 0.05)
    height = abs((centre - targets[0]) @ normal) / np.linalg.norm(normal)
    assume(height > 0.05)
    distances = np.linalg.norm(targets - centre, axis=1)
    found = trilaterate(targets, distances, centre + 0.01)
    assert found.centre == pytest.approx(centre, abs=1e-9)
    assert np.linalg.norm(targets - found.other, axis=1) == pytest.approx(distances, abs=1e-9)
    assert np.linalg.norm(found.other - centre) == pytest.approx(2 * height, abs=1e-9)


def test_trilateration_covariance_is_that_of_the_formula_differentiated() -> None:
    targets = np.array([[0.3, 0.1, 0.0], [0.0, 0.35, 0.05], [-0.2, -0.2, 0.1]])
    centre = np.array([0.05, 0.02, -0.4])
    distances = np.linalg.norm(targets - centre, axis=1)
    found = trilaterate(targets, distances, centre)
    for t in range(3):
        for i in range(3):
            step = np.zeros((3, 3))
            step[t, i] = 1e-6
            quotient = (
                trilaterate(targets + step, distances, centre).centre
                - trilaterate(targets - step, distances, centre).centre
            ) / 2e-6
            assert found.by_target[:, t, i] == pytest.approx(quotient, abs=1e-7)
        move = 1e-6 * np.eye(3)[t]
        quotient = (
            trilaterate(targets, distances + move, centre).centre
            - trilaterate(targets, distances - move, centre).centre
        ) / 2e-6
        assert found.by_distance[:, t] == pytest.approx(quotient, abs=1e-7)
    covariance = found.covariance(np.tile(1e-10 * np.eye(3), (3, 1, 1)), np.zeros((3, 3)))
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)


@pytest.mark.parametrize(
    ("targets", "distances"),
    [
        ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [1.0, 1.0, 1.0]),
        ([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [1.0, 1.0, 1.0]),
        ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [0.1, 0.1, 0.1]),
    ],
)
def test_impossible_trilaterations_are_refused(targets: list[list[float]], distances: list[float]) -> None:
    with pytest.raises(MeasurementError):
        trilaterate(np.array(targets), distances, [0.0, 0.0, 1.0])


def test_each_way_states_its_uncertainty_and_the_combination_is_not_worse() -> None:
    truth = true_centre(Cell())
    squares: dict[str, list[float]] = {}
    errors: dict[str, list[float]] = {}
    for seed in range(30):
        wrist = find_wrist_centre(axes_of_noisy_sweeps(seed))
        for estimate in (*wrist.estimates, wrist.combined):
            error = estimate.centre - truth
            squares.setdefault(estimate.way, []).append(chi_square(error, estimate.covariance))
            errors.setdefault(estimate.way, []).append(float(error @ error))
        assert wrist.findings() == ()
    for way, values in squares.items():
        assert np.mean(values) == pytest.approx(3.0, rel=0.5), way
    assert np.mean(errors["combined"]) < 1.05 * min(np.mean(errors[way]) for way in errors)


def test_an_ill_conditioned_way_counts_little() -> None:
    """Targets in the plane of the wrist centre: trilateration then says nothing across that plane."""
    arm = default_arm()
    posture = arm.posture(np.zeros(6))
    centre = posture.flange_rotation.T @ (posture.axis_points[4] - posture.flange_translation)
    plane = centre + np.array([[0.3, 0.0, 0.004], [-0.1, 0.25, 0.0], [-0.15, -0.2, -0.003]])
    cell = Cell(arm, targets=plane)
    wrist = find_wrist_centre(identify_axes(cell.sweeps(np.random.default_rng(1))))
    weights = {estimate.way: np.trace(estimate.weight) / 3 for estimate in wrist.estimates}
    assert weights["trilateration"] < 0.5 * (weights["axes"] + weights["sphere"])
    error = wrist.combined.centre - true_centre(cell)
    assert chi_square(error, wrist.combined.covariance) < 16.0
    assert np.linalg.norm(error) < 20e-6


def test_wrist_axes_that_do_not_meet_are_measured() -> None:
    for offset in (0.1e-3, 1e-3):
        cell = Cell(default_arm(wrist_offset=offset))
        found = identify_axes(cell.sweeps(np.random.default_rng(2)))
        wrist = find_wrist_centre(found)
        # the nearest point lies between: axis 6 is off axes 4 and 5, which meet
        assert 0.4 * offset < wrist.miss.distance < offset
        assert wrist.miss.probability < 1e-6
        assert wrist.miss.standard_uncertainty < 20e-6
    assert wrist.findings()


def test_a_single_wrist_sweep_leaves_the_axes_alone() -> None:
    """Sweeps of the wrist with the arm elsewhere share no sphere."""
    cell = Cell()
    sweeps = cell.sweeps()
    elsewhere = cell.sweeps(home=HOME + np.radians([0.0, 8.0, 0.0, 0.0, 0.0, 0.0]))
    parts = (*sweeps.sweeps[:3], elsewhere.sweeps[3], elsewhere.sweeps[4], sweeps.sweeps[5])
    wrist = find_wrist_centre(identify_axes(replace(sweeps, sweeps=parts)))
    assert [estimate.way for estimate in wrist.estimates] == ["axes"]
    assert wrist.combined.centre == pytest.approx(true_centre(cell), abs=1e-8)


def test_miss_of_an_imperfect_wrist_is_the_distance_of_its_axes() -> None:
    cell = Cell(imperfect_arm(4))
    wrist = find_wrist_centre(identify_axes(cell.sweeps()))
    axes = [cell.axis_at(joint, np.where(np.arange(6) < 3, HOME, 0.0)) for joint in (3, 4, 5)]
    gaps = [
        np.linalg.norm(axis.at(axis.foot(wrist.combined.centre)) - wrist.combined.centre) for axis in axes
    ]
    assert wrist.miss.distance > SIGMA
    assert max(gaps) > 0.3 * wrist.miss.distance
