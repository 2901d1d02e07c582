"""Reports of measuring software in XML: stations with joints and points, states and loads in attributes."""

import re

import numpy as np
import pytest
from support.catalogue_arms import build_nominal_robots, readings_on

import jointstiff as js

ARM = "Universal Robots UR10e"
ROBOT = next(known.robot for known in build_nominal_robots() if known.name == ARM)
READINGS = readings_on(ROBOT, seed=25, configurations=12)
SAG = np.array([0.01, 0.02, -0.5])
STATED = {"encoders": "motor", "load_point": [0, 0, 100]}
FORCE = {"force": [0, 0, -100], "units": {"force": "N"}}


def write_report():
    """Return a report with a station for each posture."""
    lines = ['<?xml version="1.0"?>', '<Report lengthUnit="mm" angleUnit="deg">']
    for number, (joints, places) in enumerate(zip(READINGS.joints, READINGS.position, strict=True), 1):
        angles = " ".join(f"{each:.3f}" for each in np.rad2deg(joints))
        lines += [f'<Station id="{number}">', f"<RobotJoints>{angles}</RobotJoints>"]
        for state, mass, shift in (("unloaded", 0, 0.0 * SAG), ("loaded", 17, SAG)):
            lines.append(f'<Measurement state="{state}" massKg="{mass}">')
            for target, place in zip(("Nest1", "Nest2"), 1e3 * places, strict=False):
                x, y, z = place + shift
                lines.append(f'<Point name="{target}" x="{x:.4f}" y="{y:.4f}" z="{z:.4f}"/>')
            lines.append("</Measurement>")
        lines.append("</Station>")
    return "\n".join([*lines, "</Report>"])


REPORT = write_report()


def change(pattern, replacement):
    """Return the report with a change."""
    return re.sub(pattern, replacement, REPORT, flags=re.DOTALL)


def read_report(folder, text, **stated):
    (folder / "report.xml").write_text(text)
    return js.read(folder / "report.xml", robot=ARM, **STATED, **stated)


@pytest.mark.parametrize(
    "text",
    [
        REPORT,
        change(r'<Point name="(\w+)" .="(\S+)" .="(\S+)" .="(\S+)"/>',
               r"<Point><Name>\1</Name><X>\2</X><Y>\3</Y><Z>\4</Z></Point>"),
        change(r'<Measurement state="(\w+)" massKg="(\d+)">', r"<Measurement><State>\1</State>"),
        change(r'<Measurement state="(\w+)".*?>(.*?)</Measurement>', r"<\1>\2</\1>"),
        change(r'<Station id="(\d+)"', r'<Station name="P\1"'),
    ],
    ids=["attributes", "elements", "state as an element", "state as a tag", "names of stations"],
)  # fmt: skip
def test_names_of_states_and_targets_in_a_report_are_read(tmp_path, text):
    campaign = read_report(tmp_path, text, **FORCE).accept().campaign
    observations = campaign.measurement_set.observations
    assert len(observations) == 12
    readings = [each for own in observations for each in own.readings]
    assert {each.target for each in readings} == {"Nest1", "Nest2"}
    shifts = [np.subtract(each.loaded, each.unloaded) for each in readings]
    assert shifts == pytest.approx(np.tile(SAG, (24, 1)), abs=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (REPORT, "'loaded mass kg' has 17 kg"),
        (
            change(r'massKg="\d+"', "").replace("<Report", '<Report payloadKg="17"'),
            '"payload kg: 17" in line 2',
        ),
    ],
    ids=["of each state", "of the report"],
)
def test_the_mass_in_a_report_is_named_as_the_likely_force(tmp_path, text, said):
    (missing,) = read_report(tmp_path, text).accept().missing
    assert said in missing
    assert "`force` is 0,0,-17kgf" in missing


def test_stations_of_a_report_with_names_keep_the_names(tmp_path):
    text = change(r'<Station id="(\d+)"', r'<Station name="P\1"')
    observations = read_report(tmp_path, text, **FORCE).accept().campaign.measurement_set.observations
    assert [each.label for each in observations] == [f"P{number}" for number in range(1, 13)]
