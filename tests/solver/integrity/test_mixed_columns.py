"""Columns that were copied or mixed: one sentence names them, and its remedy leaves nothing to report."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import first_target, prepare

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.integrity import inspect_measurements
from jointstiff.solver.integrity.values import InstrumentFrame

ROBOT, CAMPAIGN = prepare(simulate_campaign(default_arm(), load="pull", configurations=12, seed=5))
UNLOADED = np.round(CAMPAIGN.position, 7)
LOADED = np.round(CAMPAIGN.position + CAMPAIGN.deflection, 7)
MIDDLE = CAMPAIGN.targets[1]
TURN = InstrumentFrame(
    np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]), np.array([3.0, -2.0, 0.5])
)


def read(unloaded, loaded):
    return replace(CAMPAIGN, position=unloaded, deflection=loaded - unloaded)


def look(measurements, frame=None):
    return inspect_measurements(ROBOT, measurements, degrees=False, frame=frame)


def copied(state, axes, rows=slice(None), frame=None):
    """Return a set in which coordinates of the second target in one state are copies, as the tracker read."""
    unloaded, loaded = UNLOADED.copy(), LOADED.copy()
    if frame is not None:
        unloaded, loaded = (
            np.round((each - frame.translation) @ frame.rotation, 7) for each in (unloaded, loaded)
        )
    target, source = (loaded, unloaded) if state == "loaded" else (unloaded, loaded)
    target[rows, 1, axes] = source[rows, 1, axes]
    if frame is not None:
        unloaded, loaded = (each @ frame.rotation.T + frame.translation for each in (unloaded, loaded))
    return read(unloaded, loaded)


@pytest.mark.parametrize("state", ["unloaded", "loaded"])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("frame", [None, TURN], ids=["in R0", "in the tracker's frame"])
def test_a_column_that_was_copied_from_the_other_state_is_named_in_one_sentence(state, axis, frame):
    (finding,) = look(copied(state, axis, frame=frame), frame)
    column = f"'{MIDDLE} {state} {'xyz'[axis]}'"
    assert f"'{MIDDLE} loaded {'xyz'[axis]}' equals '{MIDDLE} unloaded {'xyz'[axis]}'" in finding.message
    assert "in 12 of 12 observations, digit by digit" in finding.message
    assert f"copy the right column {column} from" in finding.remedy
    assert finding.weight == "do_not_use"
    assert look(read(UNLOADED, LOADED)) == []  # the right column


def test_two_copied_columns_in_most_rows_are_one_sentence():
    (finding,) = look(copied("loaded", slice(1, 3), slice(10)))
    assert finding.message.count("in 10 of 12 observations") == 2
    assert f"leave out '{MIDDLE}'" in finding.remedy


def test_without_the_target_of_a_copied_column_nothing_is_reported():
    mistaken = copied("loaded", 1)
    arrays = {
        name: getattr(mistaken, name)[:, ::2] for name in ("position", "deflection", "in_flange", "present")
    }
    assert look(replace(mistaken, targets=mistaken.targets[::2], **arrays)) == []


def test_coarse_digits_and_still_arms_are_no_copied_columns():
    coarse = read(np.round(UNLOADED, 3), np.round(LOADED, 3))
    assert not any("digit by digit" in each.message for each in look(coarse))
    still = LOADED.copy()
    still[..., 1] = UNLOADED[..., 1]  # no target moves along y
    assert not any("a column was copied" in each.message for each in look(read(UNLOADED, still)))


def test_one_mistaken_reading_is_no_copied_column():
    findings = look(copied("loaded", 1, slice(2)))
    assert findings
    assert not any("a column was copied" in each.message for each in findings)


def test_an_array_with_states_and_targets_in_the_other_order_is_named_once():
    columns = np.stack([UNLOADED, LOADED], axis=2).reshape(12, -1)  # target by target, each in both states
    mixed = columns.reshape(-1, 2, 3, 3)
    (finding,) = look(read(mixed[:, 0], mixed[:, 1]))
    assert "mixed in all observations" in finding.message
    assert "(-1, 3, 2, 3), and give [:, :, 0] as unloaded and [:, :, 1] as loaded" in finding.remedy
    right = columns.reshape(-1, 3, 2, 3)
    assert look(read(right[:, :, 0], right[:, :, 1])) == []


def test_an_array_of_states_read_as_one_of_targets_is_named_once():
    columns = np.stack([UNLOADED, LOADED], axis=1).reshape(12, -1)  # all targets unloaded, then all loaded
    mixed = columns.reshape(-1, 3, 2, 3)
    (finding,) = look(read(mixed[:, :, 0], mixed[:, :, 1]))
    assert "(-1, 2, 3, 3), and give [:, 0] as unloaded and [:, 1] as loaded" in finding.remedy
    right = columns.reshape(-1, 2, 3, 3)
    assert look(read(right[:, 0], right[:, 1])) == []


def test_one_target_alone_has_no_mixed_axes():
    assert look(first_target(CAMPAIGN)) == []
