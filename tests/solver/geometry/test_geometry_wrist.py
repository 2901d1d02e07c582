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
from jointstiff.solver.geometry.findings import wrist_findings
from jointstiff.solver.geometry.frames import find_wrist_centre, trilaterate
from jointstiff.solver.geometry.sweeps import identify_axes

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
    unit = normal / np.linalg.norm(normal)
    assume(abs((centre - targets[0]) @ unit) > 0.05)
    distances = np.linalg.norm(targets - centre, axis=1)
    assert trilaterate(targets, distances, centre + 0.01)[0] == pytest.approx(centre, abs=1e-9)
    mirrored = centre - 2.0 * ((centre - targets[0]) @ unit) * unit
    assert trilaterate(targets, distances, mirrored)[0] == pytest.approx(mirrored, abs=1e-9)


def test_trilateration_derivatives_are_those_of_the_formula() -> None:
    targets = np.array([[0.3, 0.1, 0.0], [0.0, 0.35, 0.05], [-0.2, -0.2, 0.1]])
    centre = np.array([0.05, 0.02, -0.4])
    distances = np.linalg.norm(targets - centre, axis=1)
    _, by_distance, by_target = trilaterate(targets, distances, centre)
    for step in 1e-6 * np.eye(12):
        by_places, by_lengths = step[:9].reshape(3, 3), step[9:]
        ahead, *_ = trilaterate(targets + by_places, distances + by_lengths, centre)
        behind, *_ = trilaterate(targets - by_places, distances - by_lengths, centre)
        stated = np.einsum("itj,tj->i", by_target, by_places) + by_distance @ by_lengths
        assert (ahead - behind) / 2e-6 == pytest.approx(stated / 1e-6, abs=1e-7)


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
        assert list(wrist_findings(wrist)) == []
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
    weights = {estimate.way: estimate.weight for estimate in wrist.estimates}
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
        assert 0.4 * offset < wrist.miss_distance < offset
        assert wrist.miss_probability < 1e-6
        assert wrist.miss_uncertainty < 20e-6
    assert list(wrist_findings(wrist))


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
    gaps = [np.linalg.norm(axis.nearest(wrist.combined.centre) - wrist.combined.centre) for axis in axes]
    assert wrist.miss_distance > SIGMA
    assert max(gaps) > 0.3 * wrist.miss_distance
