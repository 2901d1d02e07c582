"""Robust loss and complementary stiffness as a user asks for them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from support.campaigns import prepare
from typer.testing import CliRunner

from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Run, RunResult
from jointstiff.service.cli.app import app
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.kinds.identification import ByJoints
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(scope="module")
def document():
    """A dead weight, and a target that was bumped in one observation."""
    simulated = simulate_campaign(default_arm(), load="dead_weight", seed=2)
    simulated["measurement_set"]["observations"][4]["readings"][1]["loaded"][2] -= 2e-3
    return simulated


@pytest.fixture
def command(monkeypatch, tmp_path, document):
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("NO_COLOR", "1")
    path = tmp_path / "campaign.json"
    path.write_text(json.dumps(document))

    def invoke(*arguments):
        return CliRunner().invoke(app, ["identify", str(path), *arguments])

    return invoke


def result(document, **options) -> RunResult:
    robot, measurements = prepare(document)
    prepared = PreparedSet(robot, measurements, [], "robot", "hash")
    return ByJoints(prepared, RunOptions(**options), "").conclude(())


def test_huber_is_nearer_the_truth_than_the_squared_loss(document):
    errors = []
    for loss in ("huber", "squared"):
        pairs = zip(result(document, loss=loss).joints, default_arm().stiffnesses, strict=True)
        errors.append(max(abs(j.compliance * k - 1) for j, k in pairs if j.compliance is not None))
    assert errors[0] < 0.5 * errors[1]


def test_readings_without_a_balance_are_identified_without_it():
    """Deflections a thousand times too large: joints as soft as they say would not carry the load."""
    wrong = simulate_campaign(default_arm(), load="pull", seed=2)
    for observation in wrong["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            moved = np.subtract(reading["loaded"], reading["unloaded"])
            reading["loaded"] = (reading["unloaded"] + 1e3 * moved).tolist()
    found = result(wrong)
    size = found.complementary_stiffness
    assert (size.included, size.iterations) == (False, 0)
    (reason,) = (each for each in found.assessment.reasons if each.code == "complementary_stiffness_matters")
    assert "had to be neglected: there is no equilibrium" in reason.message
    assert "units" in reason.remedy
    assert found.assessment.verdict == "do_not_use"
    assert "include_complementary_stiffness" not in {
        reason.action.kind for reason in found.assessment.reasons if reason.action
    }


def test_options_of_the_command(command):
    shown = command("--json", "--loss", "huber", "--huber-threshold", "1.5")
    found = Run.model_validate_json(shown.stdout)
    assert found.request.loss == "huber"
    assert found.result.robust.threshold == 1.5
    assert found.result.complementary_stiffness.included
    refused = command("--huber-threshold", "1.5")
    assert refused.exit_code == 2
    assert "huber" in refused.output


def test_table_tells_both(command):
    shown = command("--loss", "huber", "--complementary-stiffness", "neglected", "--details").stdout
    assert "c05, P11: residual of" in shown
    assert "threshold 2.8 sigma" in shown
    assert "complementary stiffness neglected" in shown


def test_resampling_is_refused_in_words(command):
    refused = command("--resample", "10:5", "--loss", "huber")
    assert refused.exit_code != 0
    assert "resampling" in refused.output
    assert "remedy" in refused.output
