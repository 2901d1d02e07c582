"""Forces as a size and a direction, and masses in the table of the readings."""

import json

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=30, configurations=14)
COUNT = len(READINGS.joints)
FIRST = 1e3 * READINGS.position[:, 0]
STATED = {"encoders": "motor", "load_point": [0, 0, 100]}
AXES = {"-x": [-1, 0, 0], "-y": [0, -1, 0], "+y": [0, 1, 0]}
WORDS = [list(AXES)[number % len(AXES)] for number in range(COUNT)]


def forces_of(proposal):
    observations = proposal.accept().campaign.measurement_set.observations
    return np.array([own.force for own in observations])


@pytest.mark.parametrize("unit", ["newton", "N"])
def test_a_pull_in_words_and_newtons_is_the_force(tmp_path, unit):
    records = [
        {
            "pose": number + 1,
            "joints_deg": {f"j{k}": angle for k, angle in enumerate(angles, 1)},
            "pull": {"direction": word, unit: 120},
            "before": place,
            "during": list(np.round(np.add(place, 0.3 * np.array(AXES[word])), 3)),
        }
        for number, (angles, place, word) in enumerate(
            zip(np.rad2deg(READINGS.joints).round(3).tolist(), FIRST.round(3).tolist(), WORDS, strict=True)
        )
    ]
    (tmp_path / "a.json").write_text(json.dumps({"measurements": records}))
    proposal = js.read(tmp_path / "a.json", robot=ARM, **STATED)
    assert f"'pull {unit}' along the directions of 'pull direction' in R0" in str(proposal)
    assert np.allclose(forces_of(proposal), [120 * np.array(AXES[word]) for word in WORDS])


def test_masses_in_the_table_of_readings_are_weights(tmp_path):
    head = ["label", *(f"J{k}" for k in range(1, 7))]
    joints = [[str(n), *(f"{each:.3f}" for each in row)] for n, row in enumerate(np.rad2deg(READINGS.joints))]
    masses = [4] * COUNT
    points = [["key", *(f"{state}_{axis}" for state in ("free", "load") for axis in "xyz"), "mass_kg"]]
    for number, (place, mass) in enumerate(zip(FIRST, masses, strict=True)):
        cells = [f"{each:.4f}" for each in (*place, *(place - [0, 0, 0.1 * mass]))]
        points.append([str(number), *cells, str(mass)])
    for name, rows in {"j.csv": [head, *joints], "p.csv": points}.items():
        (tmp_path / name).write_text("".join(",".join(row) + "\n" for row in rows))
    proposal = js.read(tmp_path / "j.csv", tmp_path / "p.csv", robot=ARM, **STATED)
    assert "'mass_kg' of p.csv as weights along −z of R0" in str(proposal)
    assert np.allclose(forces_of(proposal)[:, 2], -np.array(masses))
