"""Doubt about a load point that is stated more exactly than its ground allows; springs are exact."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.springs import SIGMA, SpringCampaign, robot_of

from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.solver.evidence.term_tests import compute_noncentrality
from jointstiff.solver.mechanics.measurements import CommonUncertainty
from jointstiff.solver.run import run

ARM = default_arm()
ROBOT = robot_of(ARM)
OPEN = CommonUncertainty(
    load_point=0.01, scale=2e-3, assumed=frozenset({"load_point"}), doubtful_load_point=1e-4
)
CLEAN = SpringCampaign.of(ARM, configurations=20)
DOUBT = "The readings raise a doubt that the load point is known to ±100 µm"


def identified(error, common, seed=8):
    """The run of a campaign whose load hangs off its stated point by an error (3,) [m]."""
    plan = CLEAN.experiment
    wrong = SpringCampaign.by(ARM, replace(plan, load_points=plan.load_points + np.array(error)))
    noise = SIGMA * np.random.default_rng(seed).standard_normal((2, *wrong.loaded.shape))
    measured = CLEAN.measurements(wrong.unloaded + noise[0], wrong.loaded + noise[1], sigma=SIGMA)
    return run(ROBOT, replace(measured, common_uncertainty=common), RunOptions())


def doubts(result):
    """The sentences of doubt among the notes of a run."""
    return [note for note in result.assessment.notes if "doubt" in note]


def test_a_point_that_is_20_mm_off_is_doubted_once_with_its_size_and_the_remedy():
    (note,) = doubts(identified([0.0, 0.014, -0.014], OPEN))
    assert note.startswith(DOUBT)
    assert "a mistake of 20 mm would change the compliance of joint_6 by " in note
    assert note.endswith(" %). Measure the load point on the hook with the tracker, and state so.")


def test_the_fit_contains_the_truth_although_the_statement_is_wrong():
    result = identified([0.0, 0.014, -0.014], OPEN)
    for joint, compliance in zip(result.joints, ARM.compliances, strict=True):
        low, high = joint.compliance_interval
        assert low <= compliance <= high


@pytest.mark.parametrize(
    ("error", "common"),
    [
        ([0.0, 0.0, 0.0], OPEN),  # the readings agree with the statement
        ([0.0, 0.014, -0.014], replace(OPEN, doubtful_load_point=None)),  # nobody insists
        ([0.0, 1e-3, 0.0], CommonUncertainty(load_point=1e-3, scale=2e-3)),  # a tracker's shot
    ],
)
def test_no_doubt_without_a_disagreement_or_with_a_ground(error, common):
    assert doubts(identified(error, common)) == []


def test_a_note_says_that_a_small_statement_without_a_ground_is_not_used():
    notes = identified([0.0, 0.0, 0.0], OPEN).assessment.notes
    (note,) = [each for each in notes if each.startswith("The load point is assumed ")]
    assert note.startswith(
        "The load point is assumed to be known to ±10 mm, as nothing states how it is known to ±100 µm."
    )


@pytest.mark.parametrize(("width", "freedom", "level"), [(3, 150, 1e-6), (1, 9, 1e-5), (6, 40, 3e-3)])
def test_the_noncentrality_gives_the_power(width, freedom, level):
    """A quotient of χ², drawn rather than computed, exceeds the F test's limit in four of five draws."""
    noncentrality = compute_noncentrality(width, freedom, level)
    generator = np.random.default_rng(1)
    explained = generator.noncentral_chisquare(width, noncentrality, 100_000) / width
    left = generator.chisquare(freedom, 100_000) / freedom
    assert np.mean(explained / left > stats.f.isf(level, width, freedom)) == pytest.approx(0.8, abs=0.01)


def test_without_freedom_no_mistake_is_found():
    assert compute_noncentrality(3, 0, 1e-6) == np.inf
    assert compute_noncentrality(0, 30, 1e-6) == np.inf
