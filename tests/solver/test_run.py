"""A whole run of arrays: the story that services, files and notebooks tell with messages."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import ARM, prepare, simulated

from jointstiff.schemas.options import CrossValidation, Resampling, RunOptions
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign
from jointstiff.solver.errors import RequestError
from jointstiff.solver.evidence import joints
from jointstiff.solver.run import Identification, run


def test_arrays_give_true_stiffnesses_with_a_verdict():
    result = run(*simulated(load="pull", seed=4), RunOptions())
    assert result.assessment.verdict == "use"
    assert result.choice.elasticity == "joints"
    within = [
        low <= truth <= (np.inf if high is None else high)
        for (low, high), truth in zip(
            (joint.stiffness_interval for joint in result.joints), ARM.stiffnesses, strict=True
        )
    ]
    assert sum(within) >= 5  # of six intervals at 95 %


def test_joints_are_identified_once_however_many_models_compete(monkeypatch):
    robot, measurements = prepare(elastic_campaign(beam_arm(ARM), configurations=16, seed=5))
    fitted, fit = [], joints.fit
    monkeypatch.setattr(joints, "fit", lambda *given: fitted.append(given) or fit(*given))
    options = RunOptions(cross_validation=CrossValidation(folds=2, draws=1), links=["joint_2"])
    result = run(robot, measurements, options)
    assert {each.model for each in result.choice.models} > {"joints", "diagonal_links"}
    assert len(fitted) == 1


def test_joints_are_described_once_as_only_the_last_fit_is_read(monkeypatch):
    """A first fit gives the residuals from which the scatter is found: nobody reads its intervals."""
    robot, measurements = simulated(load="pull", seed=4)
    fitted, described = [], []
    fit, describe = joints.fit, joints.describe
    monkeypatch.setattr(joints, "fit", lambda *given: fitted.append(given) or fit(*given))
    monkeypatch.setattr(joints, "describe", lambda fitted: described.append(fitted) or describe(fitted))
    run(robot, measurements, RunOptions())
    assert (len(fitted), len(described)) == (2, 1)


def test_joints_alone_that_win_a_comparison_are_reported_with_their_budget():
    """One of 250 arms without links has readings by chance that ask for the comparison."""
    robot, measurements = simulated(load="pull", configurations=20, force=1500.0, sigma=2e-5, seed=729)
    options = RunOptions(cross_validation=CrossValidation(folds=2, draws=1), links=["joint_2"])
    result = run(robot, measurements, options)
    assert (result.choice.source, result.choice.elasticity) == ("cross_validation", "joints")
    assert result.budget is not None
    assert result.assessment.verdict == "use"


def test_steps_of_the_long_part_come_to_the_same_as_a_whole_run():
    robot, measurements = simulated(load="pull", seed=4)
    options = RunOptions(resampling=Resampling(size=10, repetitions=50, seed=1))
    story = Identification(robot, measurements, options)
    halves = [story.long.compute(span) for span in ((0, 20), (20, 50))]
    assert story.conclude(halves) == run(robot, measurements, options)


def test_a_run_that_is_not_to_be_used_advises_no_further_reading():
    """A light load leaves joints uncertain, for which a sound run has advice."""
    robot, measurements = simulated(load="pull", configurations=4, force=60.0, seed=3)
    assert run(robot, measurements, RunOptions()).identifiability.advice
    wrong = replace(measurements, force=-measurements.force)
    result = run(robot, wrong, RunOptions())
    assert result.assessment.verdict == "do_not_use"
    assert result.identifiability.advice == []


def test_options_that_do_not_go_with_the_readings_are_refused_before_any_work():
    robot, measurements = simulated(load="pull", seed=4)
    with pytest.raises(RequestError, match="is larger than the measurement set"):
        Identification(robot, measurements, RunOptions(resampling=Resampling(size=1000)))
    with pytest.raises(RequestError, match="has no joint 'elbow'"):
        Identification(robot, measurements, RunOptions(stiffness_bounds={"elbow": (1e6, None)}))
