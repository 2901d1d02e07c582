"""Repeatability that a campaign states or shows: in the result, in the terminal and in a report."""

import json

import numpy as np
import pytest
from support.documents import campaign, changed
from support.terminal import terminal

import jointstiff as js


@pytest.fixture(scope="module")
def shared():
    """A campaign in which the tracker's station errs by 50 µm for all targets of a posture."""
    document, generator = campaign(configurations=16, seed=5), np.random.default_rng(2)
    observations = []
    for observation in document["measurement_set"]["observations"]:
        error = 5e-5 * generator.standard_normal(3)
        readings = [
            one | {"loaded": np.add(one["loaded"], error).tolist()} for one in observation["readings"]
        ]
        observations.append(observation | {"readings": readings})
    return changed(document, ("measurement_set.observations", observations))


def test_a_run_says_the_repeatability_that_its_residuals_show(shared):
    run = js.identify(shared)
    goodness = run.result.goodness
    assert goodness.repeatability_source == "residuals"
    assert goodness.repeatability_at_targets == pytest.approx(np.sqrt(3.0) * 5e-5, rel=0.3)
    assert goodness.test == "consistent"
    assert {reason.code for reason in run.result.assessment.reasons} == {"joint_poorly_known"}
    words = f"repeatability {1e6 * goodness.repeatability_at_targets:.3g} µm at the targets ("
    assert words in " ".join(run.details().split())


def test_a_clean_run_says_none():
    run = js.identify(campaign(configurations=16, seed=5))
    assert run.result.goodness.repeatability is None
    assert run.result.goodness.repeatability_at_targets is None
    assert "repeatability" not in str(run)


@pytest.mark.parametrize(("unit", "stated"), [("rad", 2e-5), ("deg", float(np.degrees(2e-5)))])
def test_a_repeatability_is_stated_in_the_unit_of_angles(unit, stated):
    document = campaign(configurations=16, seed=5)
    if unit == "deg":
        observations = [
            one | {"joints": np.degrees(one["joints"]).tolist()}
            for one in document["measurement_set"]["observations"]
        ]
        document = changed(
            document, ("measurement_set.observations", observations), ("measurement_set.units.angle", "deg")
        )
    wider = changed(document, ("measurement_set.noise.repeatability", stated))
    goodness = js.identify(wider).result.goodness
    assert (goodness.repeatability_source, goodness.repeatability) == ("given", pytest.approx(2e-5))
    for one, other in zip(js.identify(document).result.joints, js.identify(wider).result.joints, strict=True):
        assert other.standard_uncertainty > one.standard_uncertainty


@pytest.mark.parametrize("stated", [-1e-5, 2.0, "much"])
def test_a_repeatability_out_of_range_is_refused(stated):
    document = changed(campaign(configurations=4, seed=5), ("measurement_set.noise.repeatability", stated))
    with pytest.raises(js.CampaignError, match=r"noise\.repeatability"):
        js.identify(document)


def test_the_terminal_states_it_with_the_fit(shared, tmp_path):
    file = tmp_path / "shared.json"
    file.write_text(json.dumps(shared))
    shown = " ".join(terminal("identify", file, "--details", width=160).output.split())
    assert "µm at the targets (" in shown
    assert "µrad a joint, estimated)" in shown
