"""Each limit of plausibility says in which range numbers are plausible, with the unit, and how to go past it.

`LIMITS` goes past each limit on purpose. A finding whose code speaks of size is in the table, or is excluded
with a reason.
"""

import re
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from support.campaigns import estimate, only_deflections, prepare
from support.importing_samples import CAMPAIGN, answered

import jointstiff as js
from jointstiff.schemas.finding import FindingCode
from jointstiff.schemas.robot import DhRow
from jointstiff.service.conversion.robots import refuse_far_point
from jointstiff.service.runs.verdicts import find_far_points, find_implausible_deflection
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.evidence.payload import inspect_force_unit
from jointstiff.solver.fit.estimate import JointCompliance
from jointstiff.solver.geometry.poses import refuse_wrong_units
from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.mechanics.chain import chain_dh_rows
from jointstiff.solver.mechanics.measurements import EncoderReadings, Instrument
from jointstiff.solver.outcome.rules import report_implausible_joints

DOCUMENT = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
ROBOT, SET = prepare(DOCUMENT)

UNIT = r"(?:deg or mm|m|mm|µm|nm|rad|mrad|°|N|rad⁻¹|rad/rad|N·m/rad)"
PLAUSIBLE = re.compile(rf"\d *(?:· 10\S* )?\(?{UNIT}\W.{{0,60}}\bis plausible")
"""A number with its unit, and within a few words the statement that such numbers are plausible."""
PAST = re.compile(
    r"if the numbers are right|`noise.sigma` in place|correct the limits|as a URDF"
    r"|for a longer tool|a campaign file may"
)
NO_SIZES = {
    "joint_sign_suspect", "force_sign_suspect",  # tests of signs
    "target_name_suspect",  # counts of names
    "position_suspect", "reading_suspect",  # tests of scatter
}  # fmt: skip
"""Codes of suspicions that have no limit of size."""


def look(*, degrees=False, **changed):
    return inspect_measurements(ROBOT, replace(SET, **changed), degrees=degrees)


def of_deflections(*, degrees, joints):
    """Return what is found without positions, by which the unit of angles would be known."""
    return inspect_measurements(ROBOT, replace(only_deflections(SET), joints=joints), degrees=degrees)


def scaled(name, factor):
    return look(**{name: getattr(SET, name) * factor})


def of_stiffness(*stiffnesses):
    joints = [JointCompliance(f"joint_{j}", "revolute", "identified", 1.0 / k, 1e-9)
              for j, k in enumerate(stiffnesses, 1)]  # fmt: skip
    return list(report_implausible_joints(joints))


def one_far(angle):
    joints = SET.joints.copy()
    joints[3, 0] += angle
    return look(joints=joints)


def encoders():
    read = np.zeros(SET.joints.shape)
    read[:, 1] = 0.03
    return look(encoders=EncoderReadings(read, read > 0.0, 1e-6))


def of_run(**simulated):
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1, **simulated)
    document["measurement_set"].pop("noise", None)
    for each in document["measurement_set"]["observations"]:
        del each["readings"][1:]  # of one target: several show the tracker's noise by their distances
    run = js.identify(document)
    return run.result.assessment.reasons


def of_payload(factor):
    joints = [replace(each, compliance=each.compliance / factor) for each in estimate(ROBOT, SET).joints]
    return list(inspect_force_unit(ROBOT, SET, joints))


FINDINGS = {
    "angle_unit_suspect": [
        lambda: scaled("joints", 57.3),
        lambda: look(degrees=True, joints=np.deg2rad(SET.joints)),
        lambda: of_deflections(degrees=False, joints=57.3 * SET.joints),
        lambda: of_deflections(degrees=True, joints=1e-3 * SET.joints),
    ],
    "joint_outside_limits": [lambda: scaled("joints", 3.0)],
    "sigma_suspect": [lambda: look(sigma=5e-3)],
    "force_unit_suspect": [lambda: scaled("force", 1e3), lambda: scaled("force", 1e-4)],
    "length_unit_suspect": [lambda: scaled("load_point", 1e4)],
    "deflection_implausibly_large": [lambda: scaled("deflection", 1e3)],
    "deflection_implausibly_small": [lambda: scaled("deflection", 1e-5)],
    "target_off_model": [lambda: one_far(0.01), lambda: one_far(0.004)],
    "encoder_deflection_implausibly_large": [encoders],
    "stiffness_implausible": [
        lambda: of_stiffness(1e6, 30.0), lambda: of_stiffness(1e10, 1e11), lambda: of_stiffness(1e6, -5.0)
    ],
    "stiffness_against_payload": [lambda: of_payload(100.0), lambda: of_payload(1e5)],
    "sigma_implausible": [lambda: of_run(sigma=5e-4)],
    "residuals_vanish": [lambda: of_run(sigma=0.0, noise=False)],
    "prediction_implausible": [lambda: find_implausible_deflection(0.05, None)],
    "point_implausible": [lambda: find_far_points([(2.0, 0.0, 0.0)])],
}  # fmt: skip


@pytest.mark.parametrize("code", FINDINGS)
def test_a_finding_says_what_is_plausible_and_how_to_go_past(code):
    for make in FINDINGS[code]:
        found = [each for each in make() if each.code == code]
        assert found, code
        for each in found:
            assert PLAUSIBLE.search(each.message) or code == "joint_outside_limits", each.message
            assert PAST.search(each.remedy), each.remedy


def test_each_code_that_speaks_of_size_is_in_the_table():
    """`angle_scale_suspect` is the only one of a geometry: `test_geometry_sweeps.py` has its sentence."""
    codes = {each for each in get_args(FindingCode) if each.endswith("_suspect") or "implausib" in each}
    assert codes - NO_SIZES - {"angle_scale_suspect"} <= FINDINGS.keys()


def far_readings():
    robot, q = DOCUMENT["robot"], np.zeros((3, 6))
    js.Campaign.from_arrays(
        robot, q, forces=(0.0, 0.0, -1e3), deflections=np.full((3, 1, 3), 5e3), load_point=(0.0, 0.0, 100.0),
        targets={"P": (0.0, 0.0, 0.0)},
    )  # fmt: skip


ERRORS = {
    "displacement of a sweep": lambda: refuse_wrong_units(None, 2e3),
    "smallest displacement of a sweep": lambda: refuse_wrong_units(None, 5e-3),
    "length of a table": lambda: chain_dh_rows(
        [DhRow(a=0.0, alpha=0.0, d=512.0, theta=0.0)], "standard", "long"
    ),
    "tracker": lambda: Instrument((3.0, 0.0, 0.0), 1e-5, 0.0, 1e-16, 0.0).covariance(np.zeros((1, 3))),
    "tool": lambda: refuse_far_point((6.0, 0.0, 0.0), "load_point"),
    "lengths of arrays": far_readings,
}


@pytest.mark.parametrize("name", ERRORS)
def test_a_refusal_says_what_is_plausible_and_how_to_go_past(name):
    with pytest.raises((JointstiffError, js.CampaignError)) as refused:
        ERRORS[name]()
    text = str(refused.value)
    problem = getattr(refused.value, "problem", None)
    remedy = problem.remedy if problem else refused.value.remedy
    assert PLAUSIBLE.search(problem.detail if problem else text), text
    assert PAST.search(remedy), remedy


def test_an_import_says_that_targets_yield_too_far():
    answer = answered(("a.csv", CAMPAIGN.replace("-1471.5", "-0.5")))
    (said,) = answer.faults
    assert said.startswith("targets yield ")
    assert "look at the unit of the force" in said
