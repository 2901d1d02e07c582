"""Polar readings of a tracker: the robot shows how the angles are counted."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "ABB IRB 4600-60/2.05"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=20, configurations=12)
TURN = Rotation.from_euler("z", 112.0, degrees=True)
PLACES = np.add(TURN.apply(READINGS.position[:, 0].copy()), (4.0, -3.0, 0.7))
LOADED = PLACES - [0.0, 0.0, 6e-4]
STATED = {"encoders": "motor", "load_point": [0, 0, 110], "force": [0, 0, -540], "units": {"force": "N"}}


def polar(place, circle, *, zenith, clockwise):
    """Return both angles of a place, of which a circle has a number of parts, and the distance [m]."""
    x, y, z = place
    distance = np.linalg.norm(place)
    horizontal = np.arctan2(-y if clockwise else y, x) % (2.0 * np.pi)
    vertical = np.arccos(z / distance) if zenith else np.arcsin(z / distance)
    parts = circle / (2.0 * np.pi)
    return f"{parts * horizontal:.7f} {parts * vertical:.7f} {distance:.7f}"


def write(folder, top, circle=360.0, *, zenith=True, clockwise=False, **options):
    lines = [top]
    for number, places in enumerate(zip(PLACES, LOADED, strict=True), 1):
        for state, place in enumerate(places):
            lines += [f"{number:02}-{state} {polar(place, circle, zenith=zenith, clockwise=clockwise)}"]
    (folder / "raw.obs").write_text("\n".join(lines) + "\n")
    rows = [
        " ".join([f"{number:02}", *(f"{each:.4f}" for each in joints)])
        for number, joints in enumerate(np.rad2deg(READINGS.joints), 1)
    ]
    footer = ["", "-0 = free, -1 = with 55 kg (539.6 N) on the hook"]
    (folder / "poses.txt").write_text("\n".join(["IRB4600, J1-J6 (deg)", *rows, *footer]) + "\n")
    return js.read(folder / "raw.obs", folder / "poses.txt", robot=ARM, **STATED, **options)


def deflections_in(proposed):
    """Return the size [mm] of each deflection of a proposal."""
    observations = proposed.accept().campaign.measurement_set.observations
    size = np.array([own.readings[0].loaded for own in observations])
    size = size - np.array([own.readings[0].unloaded for own in observations])
    assert len(observations) == len(PLACES)
    return np.linalg.norm(size, axis=1)


@pytest.mark.parametrize(
    ("header", "circle", "zenith", "clockwise", "said"),
    [
        ("Point Hz[deg] V[deg] D[m] (V = zenith angle)", 360.0, True, False, "zenith angle"),
        ("Point Hz[gon] V[gon] D[m]", 400.0, True, True, "zenith angle, horizontal angles clockwise"),
        ("Point Azimuth[rad] Elevation[rad] Distance[m]", 2.0 * np.pi, False, False, "as elevation"),
    ],
)
def test_the_robot_shows_how_the_angles_of_polar_readings_are_counted(
    header, circle, zenith, clockwise, said, tmp_path
):
    proposed = write(tmp_path, header, circle, zenith=zenith, clockwise=clockwise)
    assert "polar readings of raw.obs as x, y, z of the instrument" in str(proposed)
    assert said in str(proposed)
    assert np.allclose(deflections_in(proposed), 0.6, atol=2e-3)


@pytest.mark.parametrize(
    "remarks",
    [
        "# Hz [gon] (ccw from x), V = Zenitwinkel [gon], D = Schrägdistanz [m]\n# Punkt Hz V D",
        "# D [m]\n# Hz, from x [gon]\n# V (zenith)\n# Hz (gon), V (gon)\n# Point  Hz  V  D",
    ],
)
def test_remarks_state_the_units_of_polar_readings(remarks, tmp_path):
    proposed = write(tmp_path, remarks, 400.0)
    assert "Hz in gon, V in gon, D in m according to remarks in raw.obs" in str(proposed)
    assert np.allclose(deflections_in(proposed), 0.6, atol=2e-3)


def test_two_units_of_a_name_in_remarks_are_none(tmp_path):
    with pytest.raises(js.CampaignError):
        write(tmp_path, "# Hz [gon], V [gon], D [m]\n# Hz [deg]\n# Point Hz V D", 400.0).accept()


@pytest.mark.parametrize(
    "options",
    [
        {"header": ["Point", "Hz[gon]", "V[gon]", "D[m]"]},
        {
            "columns": {
                "a": "horizontal angle [gon]",
                "b": "ángulo cenital [gon]",
                "c": "Schrägdistanz [m]",
            }
        },
    ],
    ids=["header", "columns"],
)
def test_polar_readings_can_be_stated(options, tmp_path):
    top = "Point a b c" if "columns" in options else "# as usual"
    proposed = write(tmp_path, top, 400.0, **options)
    assert np.allclose(deflections_in(proposed), 0.6, atol=2e-3)


def test_a_stated_part_of_a_polar_reading_alone_is_refused(tmp_path):
    columns = {"a": "horizontal angle [gon]", "b": "zenith angle"}
    with pytest.raises(js.CampaignError, match="two angles and a distance, each with its unit"):
        write(tmp_path, "Point a b c", 400.0, columns=columns).accept()


def test_angles_without_a_unit_are_no_polar_readings(tmp_path):
    with pytest.raises(js.CampaignError):
        write(tmp_path, "Point Hz V D").accept()


def test_a_line_of_words_below_a_list_of_postures_decides_no_decimal_mark(tmp_path):
    """Its words stand in columns of numbers, and one of them ends with a comma."""
    proposed = write(tmp_path, "Point Hz[deg] V[deg] D[m]")
    assert "decimal" not in str(proposed)
    assert len(proposed.accept().campaign.measurement_set.observations) == len(PLACES)
