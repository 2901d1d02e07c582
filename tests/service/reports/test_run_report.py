"""Reports of runs: what ISO/IEC 17025 asks for, the same bytes, files within, and hostile text."""

import contextlib
import io
import json
import re
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path

import pypdf
import pytest
from support.terminal import terminal

import jointstiff
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.report import Authorisation, Laboratory, Party
from jointstiff.schemas.run import Campaign, Run
from jointstiff.service import reports as service_reports
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.reports.document import draft, state_of
from jointstiff.service.reports.exports import ExportedModel, joints_csv
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.rendering import report_page, report_pdf
from jointstiff.service.reports.run import (
    ITEMS,
    RunSubject,
    predicted_compliance,
    results,
    run_document,
    uncertainty,
)
from jointstiff.simulator import default_arm, simulate_campaign

LABORATORY = Laboratory(
    name="Metrology Lab",
    address=["1 Main Street", "Nantes"],
    contact="lab@example.org",
    place="Hall 3, cell 7",
    traceability="Tracker: certificate K-17 of 2026-03-02; load cell: certificate K-18.",
    method="QM-23, revision 4",
    customer=Party(name="Arms Inc.", address=["2 Side Street"], contact="Ms Smith"),
)
METADATA = {
    "measured_at": "2026-11-20T14:30:00+01:00",
    "operator": "J. Doe",
    "instrument": "Tracker 750123",
    "serial_number": "SN-4711",
    "item_condition": "as found, new gear in joint 3",
    "conditions": "21 °C, warmed up for 30 min",
    "notes": "load by a winch",
}
HOSTILE = '#read("/etc/passwd") =1+1 </script><img src=x onerror=alert(1)> $x$ *b* @preview/cetz ‹中文›'


@pytest.fixture(scope="module")
def document():
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=12, seed=2)
    return campaign | {
        "measurement_set": campaign["measurement_set"] | METADATA,
        "run": {"complementary_stiffness": "neglected"},
    }


@pytest.fixture(scope="module")
def campaign(document):
    return Campaign.model_validate_json(json.dumps(document))


@pytest.fixture(scope="module")
def run(campaign):
    return jointstiff.identify(campaign, campaign.run)


def subject_of(campaign, run, laboratory=LABORATORY, **changes):
    readings = campaign.measurement_set.model_copy(update=changes)
    model = ExportedModel.of(run, prepare_robot(campaign.robot).robot, campaign.robot.name)
    return RunSubject(model, readings, LaboratorySettings(laboratory))


@pytest.fixture(scope="module")
def subject(campaign, run):
    return subject_of(campaign, run)


def authorised(subject, **changes):
    stated = {"note": "checked", "supersedes": None} | changes
    return Authorisation(
        run_id=subject.model.run.id,
        key_id="0123456789",
        key_name="Dr. Key",
        authorised_at=datetime(2026, 11, 21, 9, 5, tzinfo=UTC),
        content_hash=subject.content_hash(),
        number=1,
        pdf_sha256="",
        **stated,
    )


@lru_cache
def pages_of(content):
    return [" ".join(page.extract_text().split()) for page in pypdf.PdfReader(io.BytesIO(content)).pages]


@pytest.fixture(scope="module")
def signed(subject):
    state = state_of([authorised(subject)], None)
    return report_pdf(run_document(subject, state))


STATED = {
    "7.8.2.1 a": "Report on joint stiffness",
    "7.8.2.1 b": "Metrology Lab 1 Main Street, Nantes lab@example.org",
    "7.8.2.1 c": "Hall 3, cell 7",
    "7.8.2.1 d": "— End of report ",
    "7.8.2.1 e": "Arms Inc., 2 Side Street, Ms Smith",
    "7.8.2.1 f": "partial pose, covariance weights",
    "7.8.2.1 g": "Serial number SN-4711",
    "7.8.2.1 h": "Date of receipt not stated",
    "7.8.2.1 i": "Measured 2026-11-20 13:30 UTC",
    "7.8.2.1 j": "Date of issue 2026-11-21 09:05 UTC",
    "7.8.2.1 k": "Sampling: none.",
    "7.8.2.1 l": "The results relate only to the item",
    "7.8.2.1 m": "10⁶ N·m/rad",
    "7.8.2.1 n": "Deviation: the complementary stiffness is neglected.",
    "7.8.2.1 o": "Authorised by Dr. Key",
    "7.8.2.1 p": "Results from external providers: none",
    "7.8.4.1 a": "k = 2, which corresponds to a coverage probability of approximately 95 %",
    "7.8.4.1 b": "Conditions 21 °C, warmed up for 30 min",
    "7.8.4.1 c": "certificate K-17 of 2026-03-02",
    "7.8.4.1 d": "after compensation by the model, computed",
    "7.8.4.1 e": "No statement of conformity",
    "7.8.4.1 f": "Verdict on the result",
}


def test_every_item_has_a_test():
    assert [item for item, _, _ in ITEMS] == list(STATED)


@pytest.mark.parametrize("item", STATED)
def test_the_pdf_states_each_item_of_iso_17025(signed, item):
    text = " ".join(pages_of(signed))
    assert STATED[item] in text
    assert item in text


def test_a_budget_without_model_error_is_partial(subject):
    """Without a bound of the model error the head and the text say that U is partial."""
    result = subject.model.result
    parts = [part for part in result.budget.components if part.source != "model_error"]
    budget = result.budget.model_copy(update={"components": parts, "missing": ["model_error"]})
    model = replace(subject.model, result=result.model_copy(update={"budget": budget}))
    assert "k = 2, partial" in results(model, subject.readings).tables[0].head()[3]
    assert "It is partial: there is no bound of the model error" in uncertainty(model).paragraphs[0]
    named = budget.model_copy(update={"missing": ["model_error", "lack_of_fit"]})
    model = replace(subject.model, result=result.model_copy(update={"budget": named}))
    assert "the assessment names a lack of fit" in uncertainty(model).paragraphs[0]
    student = budget.model_copy(update={"coverage_factor": 2.36})
    model = replace(subject.model, result=result.model_copy(update={"budget": student}))
    assert "k = 2.36" in results(model, subject.readings).tables[0].head()[3]


def test_a_run_that_is_not_to_be_used_predicts_nothing(subject, campaign, run):
    reason = Finding(code="lack_of_fit", weight="do_not_use", message="it does not fit", remedy="read again")
    refuted = run.result.assessment.model_copy(update={"verdict": "do_not_use", "reasons": [reason]})
    result = run.result.model_copy(update={"assessment": refuted})
    other = subject_of(campaign, run.model_copy(update={"result": result}))
    assert len(predicted_compliance(subject)) == 3
    assert predicted_compliance(other) == []


def test_the_room_is_no_condition_of_the_item(signed):
    text = " ".join(pages_of(signed))
    assert "Condition of the item as found, new gear in joint 3" in text
    assert text.count("21 °C, warmed up for 30 min") == 1


def test_run_and_table_are_attached_and_it_is_pdf_a(signed, subject, run):
    reader = pypdf.PdfReader(io.BytesIO(signed))
    assert reader.attachments["joints.csv"] == [joints_csv(subject.model)]
    assert Run.model_validate_json(reader.attachments["run.json"][0]) == run
    assert b"<pdfaid:part>3</pdfaid:part><pdfaid:conformance>B</pdfaid:conformance>" in signed
    assert len(signed) <= 1_000_000


def test_a_large_run_is_attached_without_its_residuals(subject, run, monkeypatch):
    monkeypatch.setattr("jointstiff.service.reports.run.MAX_ATTACHED_BYTES", 20_000)
    attached = Run.model_validate_json(subject.run_json())
    assert attached.result.residuals == []
    assert attached.result.joints == run.result.joints


def test_states(subject, campaign, run):
    own = [authorised(subject)]
    successor = authorised(subject, supersedes=run.id).model_copy(update={"run_id": "next"})
    again = authorised(subject).model_copy(update={"number": 2})
    found = {
        "draft": draft(),
        "authorised": state_of(own, None),
        "superseded": state_of(own, successor),
        "again": state_of([*own, again], None),
    }
    texts = {
        name: " ".join(pages_of(report_pdf(run_document(subject, state)))) for name, state in found.items()
    }
    assert "DRAFT" in texts["draft"]
    assert f"It supersedes report {run.id}-1." in texts["again"]
    assert "DRAFT" not in texts["again"]
    assert "SUPERSEDED" in texts["superseded"]
    assert "Superseded by the report of run next" in texts["superseded"]
    assert "DRAFT" not in texts["authorised"]
    assert "checked" in texts["authorised"]


@pytest.mark.process
def test_two_processes_give_the_same_bytes(document, run, tmp_path):
    (tmp_path / "campaign.json").write_text(json.dumps(document))
    (tmp_path / "run.json").write_text(run.model_dump_json())
    arguments = ["report", "campaign.json", "--run", "run.json", "-o"]
    command = [sys.executable, "-m", "jointstiff", *arguments, "other.pdf"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=120)
    with contextlib.chdir(tmp_path):
        assert terminal(*arguments, "this.pdf").exit_code == 0
    assert (tmp_path / "other.pdf").read_bytes() == (tmp_path / "this.pdf").read_bytes()


def test_hostile_text_is_shown_as_text(campaign, run):
    names = {"operator": HOSTILE, "instrument": HOSTILE, "notes": f"{HOSTILE}\n{HOSTILE}"}
    laboratory = LABORATORY.model_copy(update={"name": HOSTILE, "traceability": HOSTILE})
    report = run_document(subject_of(campaign, run, laboratory, **names), draft())
    text = " ".join(pages_of(report_pdf(report)))
    assert '#read("/etc/passwd") =1+1 </script><img src=x onerror=alert(1)> $x$ *b* @preview/cetz' in text
    assert "‹‹U+4E2D›‹U+6587››" in text  # the fonts of Typst lack these
    page = report_page(report).decode()
    assert "<script" not in page
    assert "<img" not in page
    assert "&lt;img src=x onerror=alert(1)&gt; $x$ *b* @preview/cetz ‹中文›" in page


def test_the_template_reads_no_file_and_no_package():
    template = Path(service_reports.__file__).with_name("template.typ").read_text()
    assert not re.findall(r"\b(?:import|include|read|eval|plugin|csv|toml|yaml|xml|cbor)\b *\(?\"", template)
    assert set(re.findall(r"image\((\w+)", template)) == {"bytes"}
    assert re.findall(r"json\(.*", template) == ["json(bytes(sys.inputs.document))"]


def test_the_page_loads_nothing_and_has_no_scripts(subject, run):
    page = report_page(run_document(subject, draft())).decode()
    assert "<script" not in page
    assert "href" not in page
    assert "src=" not in page
    assert page.count("http") == page.count('xmlns="http://www.w3.org/2000/svg"')
    assert run.provenance.input_hash in page


@pytest.mark.parametrize("by_reading", [True, False])
def test_noise_is_stated_with_each_reading_or_estimated(campaign, run, by_reading):
    said = "stated with each reading." if by_reading else "estimated from the residuals."
    sigma = 2e-5 if by_reading else None
    observations = [
        each.model_copy(
            update={"readings": [one.model_copy(update={"sigma": sigma}) for one in each.readings]}
        )
        for each in campaign.measurement_set.observations
    ]
    subject = subject_of(campaign, run, noise=None, observations=observations)
    assert said in repr(run_document(subject, draft()))
