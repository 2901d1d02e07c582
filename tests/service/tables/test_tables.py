"""Reports of the terminal: each thing said once, the rest on demand, units of people."""

from __future__ import annotations

import io
import json
import re
from copy import deepcopy
from typing import get_args

import pytest
from rich.console import Console
from support.shared_data import shared

import jointstiff
from jointstiff.schemas.finding import combined
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Campaign
from jointstiff.service.cli.options import Units
from jointstiff.service.kinds.run import RUN
from jointstiff.service.reports.job import job_report
from jointstiff.service.reports.run import assessment
from jointstiff.service.tables.report import support
from jointstiff.service.tables.stiffness import UNITS
from jointstiff.simulator import default_arm, simulate_campaign


def printed(report):
    console = Console(file=io.StringIO(), width=200)
    console.print(report)
    return console.file.getvalue()


def identified(document, **options):
    return jointstiff.identify(Campaign.model_validate_json(json.dumps(document)), RunOptions(**options))


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="dead_weight", force=400.0, seed=1)


@pytest.fixture(scope="module")
def run(document):
    return identified(document)


@pytest.fixture(scope="module")
def bumped(document):
    """Three readings of one target wrong by 3 mm."""
    wrong = deepcopy(document)
    for observation in wrong["measurement_set"]["observations"][3:12:4]:
        observation["readings"][0]["loaded"][0] += 3e-3
    return identified(wrong)


def numbers(text):
    """The cells of the second joint's row."""
    row = next(line for line in text.splitlines() if line.startswith("│ joint_2"))
    return [float(cell) for cell in re.findall(r"(?<![_\d])\d+(?:\.\d+)?", row.replace("joint_2", ""))]


def test_the_terminal_offers_the_units_of_the_reports():
    assert list(get_args(Units)) == list(UNITS)


@pytest.mark.parametrize(
    ("unit", "label", "factor"),
    [
        ("MNm/rad", "10⁶ N·m/rad", 1e-6),
        ("kNm/deg", "kN·m/°", 1.745329e-5),
        ("Nm/arcmin", "N·m/arcmin", 2.908882e-4),
        ("Nm/rad", "N·m/rad", 1.0),
    ],
)
def test_units_of_stiffness(run, unit, label, factor):
    text = printed(job_report(RUN, run, unit=unit))
    joint = run.result.joints[1]
    value, uncertainty, low, high = numbers(text)
    assert f"interval in {label}" in text
    u = factor * joint.standard_uncertainty * joint.stiffness**2
    assert uncertainty == pytest.approx(u, rel=0.05)
    ends = [factor * end for end in joint.stiffness_interval]
    assert [value, low, high] == pytest.approx([factor * joint.stiffness, *ends], abs=0.06 * u)


def test_compliances_as_a_unit(run):
    text = printed(job_report(RUN, run, unit="urad/Nm"))
    joint = run.result.joints[1]
    value, uncertainty, low, high = numbers(text)
    u = 1e6 * joint.standard_uncertainty
    assert "Joint compliance" in text
    assert "µrad/(N·m)" in text
    assert uncertainty == pytest.approx(u, rel=0.05)
    ends = [1e6 * end for end in joint.compliance_interval]
    assert [value, low, high] == pytest.approx([1e6 * joint.compliance, *ends], abs=0.06 * u)


def test_details_are_printed_on_demand(run):
    short, whole = printed(job_report(RUN, run)), printed(job_report(RUN, run, details=True))
    for text in ("observability O1", "complementary stiffness", "χ²/dof"):
        assert text not in short
        assert text in whole
    assert short.splitlines()[0] == whole.splitlines()[0] == "Use: 5 of 6 joints passed the checks"


def test_the_report_counts_the_joints_as_the_terminal_does(run):
    section = assessment(run.result, [])
    assert section.notes[0] == "5 of 6 joints passed the checks."


def test_several_fits_count_the_joints_of_the_least(run):
    known = run.result.assessment
    fits = [known, known.model_copy(update={"joints_identified": 3})]
    assert support(combined(fits)) == "3 of 6 joints passed the checks"
    assert support(combined([])) == "the checks found no fault"


def test_at_most_three_things_to_do_and_nothing_twice(bumped):
    assert len(bumped.result.warnings) > 3
    text = printed(job_report(RUN, bumped))
    to_do = text.split("To do\n")[1].splitlines()
    assert 0 < len(to_do) <= 3
    assert text.startswith("Do not use") or text.startswith("Use with care")
    said = [line.strip() for line in text.splitlines() if line.strip()]
    assert len(said) == len(set(said))
    for reason in bumped.result.assessment.reasons[:3]:
        assert text.count(reason.message) == 1
        assert text.count(reason.remedy) <= 1


def test_a_kind_of_warnings_that_a_reason_sums_up_is_not_printed_again(bumped):
    summed = {
        warning.code
        for warning in bumped.result.warnings
        for reason in bumped.result.assessment.reasons
        if reason.message.startswith(warning.message)
    }
    assert summed
    text = printed(job_report(RUN, bumped, details=True))
    for warning in bumped.result.warnings:
        if warning.code in summed:
            assert f"{warning.message}; {warning.remedy}" not in text


def test_links_explain_what_joints_alone_call_outliers():
    result = identified(
        shared("simulated/flexible_links_20"), elasticity="joints_and_links", link_penalty=1e-3
    ).result
    assert "residual_outlier" not in {warning.code for warning in result.warnings}
