"""Assessments in the results and listings of all kinds of jobs, and as the first line of reports."""

import io
import json
from copy import deepcopy

import numpy as np
import pytest
from rich.console import Console
from support.shared_data import shared

import jointstiff
from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Campaign
from jointstiff.service.kinds.comparison import COMPARISON
from jointstiff.service.kinds.geometry import GEOMETRY
from jointstiff.service.reports.job import job_report
from jointstiff.simulator import TARGETS, default_arm, simulate_campaign
from jointstiff.solver.links.choice import LIMITS, WEIGHTS

INCLUDED = RunOptions(complementary_stiffness="included")


@pytest.fixture(scope="module")
def clean():
    """Pulls of 1500 N that show every joint, read as deflections."""
    document = simulate_campaign(default_arm(), load="pull", seed=3)
    readings = document["measurement_set"]
    readings["flange_targets"] = {name: np.array(place).tolist() for name, place in TARGETS.items()}
    for observation in readings["observations"]:
        for reading in observation["readings"]:
            moved = np.array(reading.pop("loaded")) - np.array(reading.pop("unloaded"))
            reading["deflection"] = moved.tolist()
    return document


@pytest.fixture(scope="module")
def exchanged(clean):
    """The same with the columns of two joints exchanged."""
    document = deepcopy(clean)
    for observation in document["measurement_set"]["observations"]:
        joints = observation["joints"]
        joints[1], joints[2] = joints[2], joints[1]
    return document


def of(document):
    return Campaign.model_validate_json(json.dumps(document))


def first_line(report):
    console = Console(file=io.StringIO(), width=120)
    console.print(report)
    return console.file.getvalue().splitlines()[0]


def test_a_run_that_identifies_no_joint_explains_nothing(clean):
    document = deepcopy(clean)
    readings = document["measurement_set"]
    readings["observations"] = readings["observations"][:1]
    del readings["observations"][0]["readings"][1:]
    result = jointstiff.identify(of(document), INCLUDED).result
    assert {joint.status for joint in result.joints} == {"not_observable"}
    assert result.assessment.verdict == "do_not_use"
    assert {"no_joint_identified", "no_residual_freedom", "few_postures"} == {
        r.code for r in result.assessment.reasons
    }
    assert (result.compensation, result.contributions) == (None, [])
    assert result.goodness.degrees_of_freedom == 0.0


def test_a_rigid_flange_seen_once_contradicts_no_six_joints(clean):
    """Nine coordinates of three targets are six of a flange: what is left is the targets' own noise."""
    document = deepcopy(clean)
    document["measurement_set"].pop("noise")
    del document["measurement_set"]["observations"][1:]
    result = jointstiff.identify(of(document), INCLUDED).result
    assert result.assessment.verdict == "do_not_use"
    assert result.compensation is None


def test_a_sigma_far_above_the_residuals_is_noted_and_the_run_is_for_use(clean):
    document = deepcopy(clean)
    document["measurement_set"]["noise"]["sigma"] *= 3.0
    result = jointstiff.identify(of(document), INCLUDED).result
    (warning,) = result.warnings
    assert (result.assessment.verdict, warning.code, warning.weight) == ("use", "sigma_overstated", "use")
    assert "0.3" in warning.message


@pytest.mark.slow
def test_a_penalty_under_which_no_link_bends_is_noted(clean):
    document = deepcopy(clean)
    del document["measurement_set"]["observations"][12:]
    result = jointstiff.identify(
        of(document), RunOptions(elasticity="coupled_joints", loss="absolute")
    ).result
    noted = {warning.code for warning in result.warnings}
    assert max(WEIGHTS) < result.links.penalty <= max(LIMITS)
    assert "link_penalty_at_end" in noted


def test_a_comparison_without_a_fit_is_not_for_use(clean):
    document = deepcopy(clean)
    for observation in document["measurement_set"]["observations"]:
        del observation["readings"][1:]
    methods = [{"method": "complete_pose"}, {"method": "decoupled_partial_pose"}]
    comparison = jointstiff.compare(of(document), methods=methods)
    assert {entry.assessment for entry in comparison.result.entries} == {None}
    assert comparison.result.assessment.verdict == "do_not_use"
    assert comparison.result.summary.joints_identified == 0


def test_a_pair_has_the_worse_verdict_and_says_which_side(clean, exchanged):
    run = {"complementary_stiffness": "included"}
    pair = jointstiff.compare(of(clean), of(exchanged), methods=[], run=run)
    result = pair.result
    assert result.assessment.verdict == "do_not_use"
    places = {reason.code: reason.where for reason in result.assessment.reasons}
    assert places.pop("no_common_configuration") is None
    assert {where.split(".")[0] for where in places.values()} == {"second"}
    first, second = result.entries[:2]
    assert {joint.verdict for joint in first.joints} == {"use"}
    assert {joint.verdict for joint in second.joints} == {"do_not_use"}
    assert result.summary.compensation == second.compensation < first.compensation
    assert first_line(job_report(COMPARISON, pair)).startswith("Do not use this comparison: ")


def test_a_geometry_is_assessed_by_its_findings():
    document = shared("simulated/sweeps") | {"name": "simulated"}
    request = GeometryRequest.model_validate_json(json.dumps(document))
    geometry = jointstiff.geometry(request)
    worst = {finding.weight for finding in geometry.result.findings} - {"use"}
    assert (geometry.result.assessment.verdict == "use") == (not worst)
    assert len(geometry.result.assessment.reasons) == geometry.result.summary.warning_count
    assert first_line(job_report(GEOMETRY, geometry)).startswith("Use")
