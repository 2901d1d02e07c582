"""Drift between tracker and robot base, from fixed targets read twice."""

from __future__ import annotations

import numpy as np
import pytest
from support.figures import length_in
from support.geometry_truth import chi_square, rodrigues

from jointstiff.solver.errors import MeasurementError
from jointstiff.solver.geometry.findings import drift_findings
from jointstiff.solver.geometry.frames import BaseDrift, BaseTargets

SIGMA = 15e-6
BASE = np.array([[0.6, 0.4, 0.1], [-0.5, 0.5, 0.05], [-0.4, -0.6, 0.2], [0.5, -0.5, 0.12], [0.0, 0.7, 0.6]])
AT = np.array([1.2, 0.3, 1.5])
TURN = rodrigues(np.array([0.3, -0.5, 0.8]), 60e-6)
SHIFT = np.array([40e-6, -30e-6, 80e-6])


def drift(seed: int, *, moved: bool, off: float = 0.0, along: int = 2, count: int = 5) -> BaseDrift:
    rng = np.random.default_rng(seed)
    after = BASE[:count] @ TURN.T + SHIFT if moved else BASE[:count].copy()
    after[1, along] += off
    before, after = (points + rng.normal(0.0, SIGMA, points.shape) for points in (BASE[:count], after))
    names = tuple(str(number + 1) for number in range(count))
    return BaseTargets(before, after, np.eye(3), names).drift(SIGMA, AT)


def test_a_drift_is_found_with_its_figure_and_can_be_removed() -> None:
    squares = []
    for seed in range(200):
        found = drift(seed, moved=True)
        assert found.significant
        error = found.displacement - (TURN @ AT + SHIFT - AT)
        squares.append(chi_square(error, found.displacement_covariance))
        back = found.transform_after_to_before
        point = back.apply(TURN @ AT + SHIFT)
        S = back.sensitivity(point)
        assert chi_square(point - AT, S @ back.covariance @ S.T) < 30.0
    assert np.mean(squares) == pytest.approx(3.0, rel=0.25)
    (finding,) = drift_findings(found)
    assert finding.code == "base_drifted"
    assert length_in(finding.message) == pytest.approx(np.linalg.norm(TURN @ AT + SHIFT - AT), abs=60e-6)


def test_without_drift_nothing_is_said() -> None:
    probabilities = [drift(seed, moved=False).probability for seed in range(300)]
    assert min(probabilities) > 1e-4
    assert np.mean(np.array(probabilities) < 0.1) == pytest.approx(0.1, abs=0.06)
    assert not any(list(drift_findings(drift(seed, moved=False))) for seed in range(50))


def test_one_base_target_that_moved_is_named_and_the_rest_is_no_drift_of_its_own() -> None:
    found = drift(3, moved=False, off=4e-4)
    assert found.moved_targets == ("2",)
    assert "base_target_moved" in {finding.code for finding in drift_findings(found)}
    assert found.deformation_probability < 1e-6


def test_three_targets_tell_that_one_moved_in_their_plane_but_not_which() -> None:
    found = drift(3, moved=False, off=4e-4, along=0, count=3)
    assert found.deformation_probability < 1e-6
    assert found.moved_targets == ()


def test_targets_on_a_line_show_no_motion() -> None:
    line = np.linspace(0.0, 1.0, 4)[:, None] * np.ones(3)
    with pytest.raises(MeasurementError, match="line"):
        BaseTargets(line, line, np.eye(3), ("1", "2", "3", "4")).drift(SIGMA, AT)
