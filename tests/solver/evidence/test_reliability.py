"""Mistakes that no test finds: planted in exact springs, they are found and move as foretold."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.springs import SIGMA, SpringCampaign, robot_of

from jointstiff.schemas.options import RunOptions
from jointstiff.simulator import default_arm
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.reliability import (
    LeastMistake,
    compute_noncentrality,
    describe_unseen_mistakes,
    find_least_mistakes,
)
from jointstiff.solver.evidence.term_tests import MISTAKE_LEVEL
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import CommonUncertainty
from jointstiff.solver.run import run

ARM = default_arm()
ROBOT = robot_of(ARM)
SETTINGS = Settings.from_options(RunOptions(), ROBOT)
STATED = CommonUncertainty(load_point=1e-4, scale=3e-3)
ASSUMED = CommonUncertainty(load_point=0.01, scale=0.01, assumed=frozenset({"load_point", "force_scale"}))
CLEAN = SpringCampaign.of(ARM, configurations=20)


def read(campaign, generator, common=STATED):
    """Readings with noise, with the loads as stated."""
    exact = np.stack([campaign.unloaded, campaign.loaded])
    noise = SIGMA * generator.standard_normal(exact.shape)
    return replace(CLEAN.measurements(*(exact + noise), sigma=SIGMA), common_uncertainty=common)


def least_mistakes(measurements):
    """The identification by joints alone, and the least mistakes by name."""
    joints = JointsAlone(Rows(ROBOT, measurements), SETTINGS)
    tests = len(joints.screening.tests)
    found = find_least_mistakes(joints.rows, joints.estimate, tests)
    return joints, {each.name: each for each in found}


def planted(name, unknowns):
    """The campaign with a mistake, balanced by exact springs."""
    plan, mistake = CLEAN.experiment, np.asarray(unknowns)
    if name == "load_point":
        return SpringCampaign.by(ARM, replace(plan, load_points=plan.load_points + mistake))
    if name == "constant_force":
        return SpringCampaign.by(ARM, replace(plan, forces=plan.forces + mistake))
    return replace(CLEAN, loaded=CLEAN.loaded + mistake)


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


@pytest.mark.slow
@pytest.mark.parametrize("name", ["load_point", "constant_force", "shift"])
def test_the_least_mistake_is_found_in_four_of_five_campaigns(name):
    generator = np.random.default_rng(5)
    found = least_mistakes(read(CLEAN, generator))[1]
    campaign, hits = planted(name, found[name].unknowns), 0
    for _ in range(60):
        tests = JointsAlone(Rows(ROBOT, read(campaign, generator)), SETTINGS).screening.tests
        p_value = next(test.p_value for test in tests if test.name == name and test.first is None)
        hits += p_value < MISTAKE_LEVEL / len(tests)
    assert 0.65 <= hits / 60 <= 0.95  # three standard deviations about 0.8


@pytest.mark.parametrize("common", [STATED, ASSUMED])
@pytest.mark.parametrize("name", ["load_point", "shift"])
def test_a_mistake_moves_its_joint_as_far_as_foretold(name, common):
    """The change between two campaigns with the same noise has no noise."""
    joints, found = least_mistakes(read(CLEAN, np.random.default_rng(6), common))
    mistake = found[name]
    wrong = planted(name, 0.5 * np.array(mistake.unknowns))
    moved = JointsAlone(Rows(ROBOT, read(wrong, np.random.default_rng(6), common)), SETTINGS).estimate
    j = ROBOT.joint_names.index(mistake.joint)
    change = abs(moved.compliance[j] - joints.estimate.compliance[j])
    foretold = 0.5 * mistake.moves * joints.estimate.joints[j].standard_uncertainty
    assert change == pytest.approx(foretold, rel=0.3)


def test_an_assumed_load_point_is_corrected_so_that_a_mistake_moves_less():
    """The fit corrects what is assumed to 10 mm; what is stated to 0.1 mm it believes."""
    moves = [
        least_mistakes(read(CLEAN, np.random.default_rng(7), common))[1]["load_point"].moves
        for common in (STATED, ASSUMED)
    ]
    assert moves[0] > 10.0
    assert moves[1] < 0.4 * moves[0]


@pytest.mark.parametrize(
    ("common", "remedy"), [(STATED, "check the load point to"), (ASSUMED, "state its uncertainty")]
)
def test_a_run_names_what_it_cannot_show_and_remains_to_be_used(common, remedy):
    result = run(ROBOT, read(CLEAN, np.random.default_rng(8), common), RunOptions())
    assert result.assessment.verdict == "use"
    assert not result.warnings
    (note,) = [each for each in result.assessment.notes if each.startswith("The readings cannot show ")]
    assert "an error of the load point up to" in note
    assert "would change the compliance of joint_5 by" in note
    assert remedy in note
    (test,) = [test for test in result.causes if test.name == "load_point"]
    assert (test.joint, test.unit) == ("joint_5", "m")
    assert 0.04 < test.least_found < 0.1
    assert test.moves > 3.0


def test_a_mistake_that_is_found_is_a_reason_and_no_remark():
    generator = np.random.default_rng(9)
    _, found = least_mistakes(read(CLEAN, generator))
    wrong = planted("constant_force", 3.0 * np.array(found["constant_force"].unknowns))
    result = run(ROBOT, read(wrong, generator), RunOptions())
    assert "alternative_explains_better" in {reason.code for reason in result.assessment.reasons}
    assert {test.moves for test in result.causes} == {None}
    assert not any("cannot show" in note for note in result.assessment.notes)


def test_the_remark_has_sizes_and_what_to_measure():
    mistakes = [
        LeastMistake("load_point", "m", 0.025, "joint_5", (0.0, 0.0, 0.025), 10.0),
        LeastMistake("play", "rad", 2e-4, "joint_4", (2e-4,), 4.0),
        LeastMistake("shift", "m", 2e-5, "joint_1", (2e-5, 0.0, 0.0), 2.9),
    ]
    assert describe_unseen_mistakes(mistakes) == (
        "The readings cannot show an error of the load point up to 25 mm, which would change the "
        "compliance of joint_5 by 10 times its standard uncertainty; nor play of up to 0.2 mrad in the "
        "gears, which would change the compliance of joint_4 by 4 times its standard uncertainty. To show "
        "such mistakes, check the load point to within 2.5 mm, or hang the load on a second point in four "
        "postures; read three postures again at half the load."
    )
    assert describe_unseen_mistakes(mistakes[2:]) is None


def test_a_remark_describes_three_mistakes_and_counts_the_others():
    mistakes = [LeastMistake("shift", "m", 2e-5, "joint_1", (2e-5, 0.0, 0.0), 4.0)] * 5
    note = describe_unseen_mistakes(mistakes)
    assert note.count("joint_1") == 3
    assert "(and 2 more, in `causes`). To show such mistakes, " in note


def test_a_mistake_that_anybody_sees_is_not_considered():
    """With pulls in one direction a constant force is a scale of the load, which no test shows."""
    plan = CLEAN.experiment
    down = replace(plan, forces=np.broadcast_to([0.0, 0.0, -1500.0], plan.forces.shape).copy())
    campaign = SpringCampaign.by(ARM, down)
    noise = SIGMA * np.random.default_rng(3).standard_normal((2, *campaign.loaded.shape))
    stated = campaign.measurements(campaign.unloaded + noise[0], campaign.loaded + noise[1], sigma=SIGMA)
    found = least_mistakes(replace(stated, common_uncertainty=STATED))[1]
    assert found["constant_force"].size <= 150.0 * (1.0 + 1e-12)
    assert found["load_point"].size <= 0.2 * (1.0 + 1e-12)
