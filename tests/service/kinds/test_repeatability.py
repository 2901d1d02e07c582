"""Repeatability that a campaign states or shows: in the result, in the terminal and in a report."""

import json

import numpy as np
import pytest
from support.campaigns import prepare
from support.documents import campaign, changed
from support.terminal import terminal

import jointstiff as js
from jointstiff.solver.mechanics.postures import Postures


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
    assert run.result.assessment.verdict == "use"
    words = f"repeatability {1e6 * goodness.repeatability_at_targets:.3g} µm at the targets ("
    assert words in " ".join(run.details().split())


def test_a_clean_run_allows_for_some_and_says_so():
    run = js.identify(campaign(configurations=16, seed=5))
    goodness = run.result.goodness
    assert goodness.repeatability_source == "assumed"
    assert 0.0 < goodness.repeatability < 1e-5
    assert "allowed for)" in " ".join(run.details().split())
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
    assert goodness.repeatability_source == "given"
    assert 0.3e-5 < goodness.repeatability < 2e-5  # the arm of the readings repeats exactly
    for one, other in zip(js.identify(document).result.joints, js.identify(wider).result.joints, strict=True):
        assert other.standard_uncertainty > one.standard_uncertainty


def test_the_pose_repeatability_of_a_data_sheet_is_converted_by_the_geometry():
    """A deflection is the difference of two places, each of which the arm reaches with that repeatability."""
    document = campaign(configurations=16, seed=5)
    stated = changed(document, ("measurement_set.noise.pose_repeatability", 1e-4))
    robot, measurements, *_ = prepare(stated)
    # By drawn turns of all joints: RP is the mean distance to the mean, and three standard deviations more.
    generator, turn = np.random.default_rng(7), measurements.repeatability / np.sqrt(2.0)
    squares = []
    for joints in measurements.joints:
        drawn = joints + turn * generator.standard_normal((200, robot.n))
        at = Postures(robot, drawn).to_base(np.broadcast_to([0.1, 0.0, 0.05], (200, 1, 3)))[:, 0]
        distances = np.linalg.norm(at - at.mean(axis=0), axis=1)
        squares.append((distances.mean() + 3.0 * distances.std(ddof=1)) ** 2)
    assert np.sqrt(np.mean(squares)) == pytest.approx(1e-4, rel=0.2)


def test_two_statements_of_the_repeatability_are_refused():
    document = changed(
        campaign(configurations=4, seed=5),
        ("measurement_set.noise.repeatability", 1e-5),
        ("measurement_set.noise.pose_repeatability", 1e-4),
    )
    with pytest.raises(js.CampaignError, match="pose_repeatability"):
        js.identify(document)


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
