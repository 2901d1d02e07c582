"""Certificates: the structure of DCC 3.3.0, without its schema, and by it where it is at hand."""

import os
from dataclasses import replace
from datetime import UTC, date, datetime
from xml.etree import ElementTree

import numpy as np
import pytest
from reference.kinematics import flange_by_pinocchio
from support.api import file_at

import jointstiff as js
from jointstiff.schemas.report import Laboratory, Party
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.reports.certificate import NAMESPACES, certificate
from jointstiff.service.reports.document import State, draft
from jointstiff.service.reports.exports import ExportedModel
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.run import RunSubject, predicted_compliance
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.own_weight import unloaded_campaign
from jointstiff.solver.errors import RequestError

LABORATORY = Laboratory(
    name="Metrology Lab",
    address=["1 Main Street", "44000 Nantes"],
    country="FR",
    languages=["fr"],
    responsible="A. Martin",
    kind_of_place="customer",
    ended_on=date(2026, 11, 21),
)
MEASURED = {"measured_at": "2026-11-20T14:30:00+01:00", "instrument": "Tracker 750123"}


@pytest.fixture(scope="module")
def subject():
    document = simulate_campaign(default_arm(), load="dead_weight", configurations=12, seed=2)
    document["measurement_set"] |= MEASURED
    run = js.identify(document)
    model = ExportedModel.of(run, prepare_robot(run.campaign.robot).robot, "cell <3>")
    return RunSubject(model, run.campaign.measurement_set, LaboratorySettings(LABORATORY))


def read(content):
    return ElementTree.fromstring(content)  # noqa: S314 - our own


def names(element):
    return [child.tag.partition("}")[2] for child in element]


def texts(element, path):
    return [each.text for each in element.findall(path, NAMESPACES)]


@pytest.fixture(scope="module")
def root(subject):
    return read(certificate(subject, draft()))


def test_customer_and_serial_number_are_optional(root, subject):
    assert texts(root, ".//dcc:customer/dcc:name/dcc:content") == ["not stated"]
    identification = root.find(".//dcc:item//dcc:identification", NAMESPACES)
    assert next(child.text for child in identification) == "calibrationLaboratory"
    laboratory = LABORATORY.model_copy(
        update={"customer": Party(name="Arms Inc.", address=["2 Side Street"])}
    )
    readings = subject.readings.model_copy(update={"serial_number": "SN-4711"})
    stated = replace(subject, readings=readings, settings=LaboratorySettings(laboratory))
    full = read(certificate(stated, State("authorised", "By A", 2, datetime(2026, 11, 25, tzinfo=UTC))))
    assert texts(full, ".//dcc:customer/dcc:name/dcc:content") == ["Arms Inc."]
    assert texts(full, ".//dcc:item//dcc:identification/dcc:value") == ["SN-4711"]
    assert texts(full, ".//dcc:coreData/dcc:issueDate") == ["2026-11-25"]
    assert texts(full, ".//dcc:uniqueIdentifier")[0].endswith("-2")


def test_the_results_are_those_of_the_run(root, subject):
    results = root.findall(".//dcc:result", NAMESPACES)
    run, budget = subject.model.run, subject.model.result.budget
    for result, joint in zip(results, run.result.joints, strict=False):
        assert texts(result, "dcc:name/dcc:content") == [f"Stiffness of {joint.name}"]
        if joint.stiffness is None:
            assert texts(result, ".//dcc:noQuantity/dcc:content")[0].startswith("No number: ")
            continue
        values = [float(text) for text in texts(result, ".//si:value")]
        assert values == [joint.stiffness, *(end for end in joint.stiffness_interval if end is not None)]
        assert set(texts(result, ".//si:unit")) == {r"\newton\metre\radian\tothe{-1}"}
        place = budget.joints.index(joint.name)
        of_compliance = budget.expanded_with_model_error[place] / budget.coverage_factor
        (u,), (k,) = texts(result, ".//si:valueExpandedMU"), texts(result, ".//si:coverageFactor")
        assert float(u) / float(k) == pytest.approx(of_compliance * joint.stiffness**2, rel=1e-12)
        assert texts(result, ".//si:coverageProbability") == ["0.95"]


def test_the_compliance_of_the_flange_is_called_predicted_and_is_that_of_the_springs(root, subject):
    """Compare with J C Jᵀ by finite differences of the kinematics, for the axes that a weight shows."""
    result = root.findall(".//dcc:result", NAMESPACES)[-1]
    assert texts(result, "dcc:name/dcc:content")[0].startswith("Predicted static compliance")
    assert "not measured" in texts(result, "dcc:description/dcc:content")[0]
    quantity_names = texts(result, ".//dcc:quantity/dcc:name/dcc:content")
    assert all("redicted displacement" in text for text in quantity_names)
    robot = subject.model.run.campaign.robot.model
    assert subject.readings.units.angle == "rad"
    joints = subject.model.robot.joint_names
    q, step = np.array(subject.readings.observations[0].joints), 1e-6
    postures = [q + d * e for e in np.eye(6) for d in (step, -step)]
    flange = [
        flange_by_pinocchio(robot.urdf, dict(zip(joints, each, strict=True)), robot.base, robot.flange)[:3, 3]
        for each in postures
    ]
    jacobian = (np.array(flange[::2]) - np.array(flange[1::2])).T / (2 * step)
    compliance = np.array([joint.compliance or 0.0 for joint in subject.model.run.result.joints])
    expected = jacobian * compliance @ jacobian.T
    quantities = np.array([float(text) for text in texts(result, ".//si:value")]).reshape(-1, 4)
    values, lengths = quantities[:, :3], quantities[:, 3]
    np.testing.assert_allclose(lengths, np.linalg.norm(values, axis=1), rtol=1e-12)
    assert all(text.startswith("Length of the predicted") for text in quantity_names[3::4])
    budgets = [case.budget for case in predicted_compliance(subject) if case.displacement is not None]
    stated = [float(text) for text in texts(result, ".//si:valueExpandedMU")]
    np.testing.assert_allclose(stated, [each.expanded_with_model_error / 100.0 for each in budgets])
    forces = [text.split()[-1] for text in quantity_names[::4]]
    np.testing.assert_allclose(
        values, expected[["XYZ".index(axis) for axis in forces]], rtol=2e-3, atol=1e-10
    )


def test_a_run_by_own_weight_states_its_uncertainty_by_the_interval():
    document = unloaded_campaign(default_arm(), configurations=30, seed=1)
    document["measurement_set"] |= MEASURED
    run = js.identify(document)
    model = ExportedModel.of(run, prepare_robot(run.campaign.robot).robot, "cell")
    subject = RunSubject(model, run.campaign.measurement_set, LaboratorySettings(LABORATORY))
    results = read(certificate(subject, draft())).findall(".//dcc:result", NAMESPACES)
    assert run.result.budget is None
    known = [
        (result, joint)
        for result, joint in zip(results, run.result.joints, strict=False)
        if joint.stiffness is not None
    ]
    assert len(known) == 5
    for result, joint in known:
        u, factor, probability = (
            float(*texts(result, f".//si:{name}"))
            for name in ("valueExpandedMU", "coverageFactor", "coverageProbability")
        )
        low, high = joint.stiffness_interval
        assert joint.stiffness - u <= low * (1 + 1e-12)
        assert joint.stiffness + u >= high * (1 - 1e-12)
        assert (probability, factor) == (0.95, pytest.approx(1.959964, abs=1e-6))
    described = texts(results[-1], "dcc:description/dcc:content")
    assert described[0].endswith("No uncertainty is stated of these predictions.")


@pytest.mark.parametrize(
    ("laboratory", "measured_at", "where"),
    [
        (None, True, "laboratory"),
        (LABORATORY.model_copy(update={"country": None}), True, "laboratory"),
        (LABORATORY.model_copy(update={"responsible": None}), True, "laboratory"),
        (LABORATORY.model_copy(update={"ended_on": date(2026, 11, 19)}), True, "laboratory.ended_on"),
        (LABORATORY, False, "measurement_set.measured_at"),
    ],
)
def test_what_every_certificate_states_is_not_guessed(subject, laboratory, measured_at, where):
    readings = subject.readings
    if not measured_at:
        readings = readings.model_copy(update={"measured_at": None})
    with pytest.raises(RequestError) as refused:
        certificate(replace(subject, readings=readings, settings=LaboratorySettings(laboratory)), draft())
    assert refused.value.where == where
    assert refused.value.remedy


@pytest.mark.parametrize(
    ("measured_at", "ended_on", "days"),
    [
        ("2026-11-20T20:00:00-08:00", date(2026, 11, 20), ["2026-11-20", "2026-11-20"]),
        ("2026-11-20T20:00:00-08:00", None, ["2026-11-21", "2026-11-21"]),
        ("2026-11-20T00:30:00+01:00", date(2026, 11, 20), ["2026-11-19", "2026-11-20"]),
    ],
)
def test_days_are_those_of_utc_or_of_the_laboratory(subject, measured_at, ended_on, days):
    """20:00 in San Francisco is the next day in UTC, in which the set keeps its time."""
    at = datetime.fromisoformat(measured_at).astimezone(UTC)
    readings = subject.readings.model_copy(update={"measured_at": at})
    settings = LaboratorySettings(LABORATORY.model_copy(update={"ended_on": ended_on}))
    core = read(certificate(replace(subject, readings=readings, settings=settings), draft()))
    assert [*texts(core, ".//dcc:beginPerformanceDate"), *texts(core, ".//dcc:endPerformanceDate")] == days


def test_only_texts_of_this_program_have_its_language(subject):
    own = {
        "name": "Messlabor",
        "address": ["Hauptstraße 1"],
        "traceability": "Schein K-17",
        "method": "Anweisung 4",
        "conditions": "warm gelaufen",
        "customer": Party(name="Kunde", address=["Nebenstraße 2"]),
        "languages": ["de", "en", "de"],
    }
    laboratory = LABORATORY.model_copy(update=own)
    readings = subject.readings.model_copy(update={"conditions": None})
    settings = LaboratorySettings(laboratory)
    root = read(certificate(replace(subject, readings=readings, settings=settings), draft()))
    assert texts(root, ".//dcc:usedLangCodeISO639_1") == ["en", "de"]
    contents = [(each.text, each.get("lang")) for each in root.iter(f"{{{NAMESPACES['dcc']}}}content")]
    foreign = (
        "Messlabor",
        "Hauptstr",
        "K-17",
        "Anweisung",
        "gelaufen",
        "Kunde",
        "Nebenstr",
        "A. Martin",
        "750123",
    )
    for text in foreign:
        assert [language for content, language in contents if text in content] == [None], text
    rest = [language for content, language in contents if not any(text in content for text in foreign)]
    assert set(rest) == {"en"}


def test_hostile_names_are_text(subject):
    hostile = "]]><a>\x00\x1b[31m\ud800 &amp;"
    readings = subject.readings.model_copy(update={"instrument": hostile})
    root = read(certificate(replace(subject, readings=readings), draft()))
    assert texts(root, ".//dcc:measuringEquipment/dcc:name/dcc:content") == ["]]><a>  [31m  &amp;"]


@pytest.mark.skipif("DCC_XSD" not in os.environ, reason="DCC_XSD names no schema (dcc.xsd of version 3.3.0)")
def test_the_schema_accepts_it(subject):
    xmlschema = pytest.importorskip("xmlschema")
    schema = xmlschema.XMLSchema(os.environ["DCC_XSD"])
    assert [str(error) for error in schema.iter_errors(certificate(subject, draft()).decode())] == []


def test_a_service_and_this_process_answer_with_a_certificate(local, subject, tmp_path):
    campaign = subject.model.run.campaign
    path = tmp_path / "lab.toml"
    path.write_text('name = "Lab"\ncountry = "FR"\nresponsible = "A. Martin"\n')
    run = js.identify(campaign)
    run.report(tmp_path / "certificate.xml", path)
    here = read((tmp_path / "certificate.xml").read_bytes())
    assert texts(here, ".//dcc:respPerson/dcc:person/dcc:name/dcc:content") == ["A. Martin"]
    with pytest.raises(js.CampaignError, match="country"):
        run.report(tmp_path / "certificate.xml")
    document = campaign.model_dump(mode="json", exclude_unset=True)
    stored = local.request("POST", "/v1/campaigns", json=document).json()
    answer = local.get(file_at(stored, "report.xml"))
    assert answer.status_code == 422
    assert "country" in answer.json()["remedy"]
