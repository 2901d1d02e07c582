"""Repeated readings in columns of their own: `Reading 1` to `Reading 3` below each state."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on
from support.strange_files import table

import jointstiff as js

ARM = "FANUC M-20iD/25"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=33, configurations=12)
FIRST = 1e3 * READINGS.position  # (N, K, 3) [mm]
SAG = np.array([0.05, 0.1, -0.6])
NOISE = 0.02 * np.random.default_rng(33).standard_normal((2, 3, *FIRST.shape))  # by state and repeat
STATED = {"encoders": "motor", "load_point": [0, 0, 90], "length_unit": "mm"}
FORCE = {"force": [0, 0, -196], "units": {"force": "N"}}
JOINTS = [f"J{number}" for number in range(1, 7)]


def write(folder, states, repeat, targets=("",), steps=(1.0, 1.0, 1.0)):
    """Write a table with rows of states, of targets and repeats, and of axes above the numbers."""
    groups = [f"{target} {repeat} {number}".strip() for target in targets for number in (1, 2, 3)]
    of_states, of_groups = 7 * [""], 7 * [""]
    for state in states:
        of_states += [state, *(3 * len(groups) - 1) * [""]]
        of_groups += [cell for group in groups for cell in (group, "", "")]
    rows = [of_groups, ["Postura", *JOINTS, *(2 * len(groups) * list("XYZ"))]]
    for posture, joints in enumerate(np.rad2deg(READINGS.joints)):
        cells = [str(posture + 1), *(f"{each:.3f}" for each in joints)]
        for is_loaded in range(2):
            for target in range(len(targets)):
                for repeat_number, step in enumerate(steps):
                    noise = NOISE[is_loaded, repeat_number, posture, target]
                    place = FIRST[posture, target] + is_loaded * step * SAG + noise
                    cells += [f"{each:.3f}" for each in place]
        rows.append(cells)
    (folder / "a.csv").write_text(table(of_states, rows))
    return folder / "a.csv"


@pytest.mark.parametrize(
    ("states", "repeat", "targets"),
    [
        (("SIN PESO", "CON PESO (20 kg)"), "Lectura", ("",)),
        (("ohne Last", "mit Last (20 kg)"), "Messung", ("",)),
        (("unloaded", "loaded (20 kg)"), "reading", ("SMR A", "SMR B")),
    ],
)
def test_the_mean_of_repeats_below_a_state_is_read(states, repeat, targets, tmp_path):
    proposed = js.read(write(tmp_path, states, repeat, targets), robot=ARM, **STATED)
    assert "3 repeats of" in str(proposed)
    observations = proposed.accept().campaign.measurement_set.observations
    mean = NOISE.mean(axis=1)
    for number, own in enumerate(observations):
        assert len(own.readings) == len(targets)
        for target, each in enumerate(own.readings):
            shift = SAG + mean[1, number, target] - mean[0, number, target]
            assert np.allclose(np.subtract(each.loaded, each.unloaded), shift, atol=2e-3)
        assert own.force == (0.0, 0.0, -20.0)  # kgf


@pytest.mark.parametrize("scale", [1.0, 0.15])
def test_steps_of_a_load_are_no_repeats(scale, tmp_path):
    """The smaller steps are as near to each other as repeats are."""
    steps = scale * np.array([1.0, 2.0, 3.0]) / 3.0
    file = write(tmp_path, ("SIN PESO", "CON PESO"), "paso", steps=steps)
    with pytest.raises(js.CampaignError, match=r"'paso 1' and 'paso 2' are .* mm apart"):
        js.read(file, robot=ARM, **FORCE, **STATED).accept()


def test_x_of_one_repeat_makes_no_position_with_y_of_the_next(tmp_path):
    """Columns that headers name as x, y and z are a position with each other only."""
    file = write(tmp_path, ("SIN PESO", "CON PESO"), "paso", steps=(1.0, 2.0, 3.0))
    with pytest.raises(js.CampaignError) as refused:
        js.read(file, robot=ARM, **FORCE, **STATED).accept()
    assert "8–10 as paso 1 unloaded" in str(refused.value)
