"""Displacements in micrometres beside coordinates `X0`, `Y0`, `Z0`, below titles of several cells."""

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=25, configurations=12)
FIRST = 1e3 * READINGS.position[:, 0]
SAG = np.array([10, 20, -500])
STATED = {"encoders": "motor", "load_point": [0, 0, 100], "force": [0, 0, -100], "units": {"force": "N"}}
TITLES = ["Essai de souplesse", "Traction (treuil + peson);500 N;suivant -Y", ""]


@pytest.mark.parametrize("initial", ["{}0 (mm)", "{}_0", "{} 0 [mm]"])
@pytest.mark.parametrize("titles", [[], TITLES], ids=["no titles", "titles"])
def test_displacements_are_added_to_the_initial_positions(tmp_path, initial, titles):
    joints = [f"q{number} (°)" for number in range(1, 7)]
    header = ["N°", *joints, *map(initial.format, "XYZ"), "dX (µm)", "dY (µm)", "dZ (µm)", "|d| (µm)"]
    lines = [*titles, ";".join(header)]
    for number, (angles, place) in enumerate(zip(np.rad2deg(READINGS.joints), FIRST, strict=True), 1):
        cells = [f"{each:.3f}" for each in (*angles, *place)]
        lines.append(";".join([str(number), *cells, *map(str, SAG), "500.5"]))
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    proposal = js.read(tmp_path / "a.csv", robot=ARM, **STATED)
    assert "dX (µm), dY (µm), dZ (µm) added to the positions without load; not read: |d| (µm)" in str(
        proposal
    )
    for own in proposal.accept().campaign.measurement_set.observations:
        (each,) = own.readings
        assert np.allclose(np.subtract(each.loaded, each.unloaded), 1e-3 * SAG, atol=1e-4)


@pytest.mark.parametrize(
    ("initial", "shift"),
    [
        ("{} sem carga (mm)", "Desloc. {} com carga (µm)"),
        ("{} unbelastet [mm]", "Verschiebung {} [Mikrometer]"),
        ("{} без груза, мм", "прогиб {}, мкм"),
        ("{} 空载 [mm]", "位移 {} [微米]"),
        ("{} sin carga (mm)", "Desplaz. {} (µm)"),
    ],
)
def test_displacements_in_micrometres_make_readings_of_an_arm_as_its_model(tmp_path, initial, shift):
    """Only the word for unloaded shows that no controller computed the positions of an arm without errors."""
    arm = readings_on(ROBOT, seed=25, configurations=12, length=0.0, angle=0.0)
    header = [*(f"J{number} [deg]" for number in range(1, 7)), *map(initial.format, "XYZ")]
    lines = [";".join([*header, *map(shift.format, "XYZ")])]
    for angles, place in zip(np.rad2deg(arm.joints), 1e3 * arm.position[:, 0], strict=True):
        cells = [*(f"{each:.2f}" for each in angles), *(f"{each:.3f}" for each in place)]
        lines.append(";".join([*cells, *map(str, SAG)]))
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    campaign = js.read(tmp_path / "a.csv", robot=ARM, by_order=True, **STATED).accept().campaign
    (shifts,) = {
        tuple(np.round(1e3 * np.subtract(each.loaded, each.unloaded)))
        for observation in campaign.measurement_set.observations
        for each in observation.readings
    }
    assert shifts == tuple(SAG)
