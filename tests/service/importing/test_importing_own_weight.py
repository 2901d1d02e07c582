"""Unloaded positions of a robot with masses: a set for its own weight; masses as a table beside."""

import pytest
from support.importing_samples import sources_of
from support.workbooks import table_of

import jointstiff
from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.resources.imports import import_files
from jointstiff.simulator import default_arm
from jointstiff.simulator.own_weight import unloaded_campaign

CAMPAIGN = unloaded_campaign(default_arm(), configurations=30, seed=4)
POSITIONS = "grid.csv", table_of(CAMPAIGN) + b"\n"
BARE = {name: value for name, value in CAMPAIGN["robot"].items() if name != "bodies"}


def masses(*, joint="{name}", bound="± [%]", scale=100.0):
    rows = [f"body;joint;mass [kg];{bound};cog x [mm];cog y [mm];cog z [mm]"]
    for number, body in enumerate(CAMPAIGN["robot"]["bodies"], start=1):
        named = joint.format(name=body["joint"], number=number)
        width = body["mass_uncertainty"] * (body["mass"] if scale == 1.0 else scale)
        centre = ";".join(f"{1e3 * number:.10g}" for number in body["centre"])
        rows.append(f"{body['name']};{named};{body['mass']!r};{width:.12g};{centre}")
    return "masses.csv", "\n".join(rows) + "\n"


def prepared(document):
    return prepare_robot(RobotDocument.model_validate(document)).robot


def test_a_robot_with_masses_makes_a_set_that_is_identified_without_an_option(tmp_path):
    """The numbers are those of the campaign as it was simulated; nothing says `weight`."""
    table = tmp_path / "grid.csv"
    table.write_bytes(POSITIONS[1])
    options = {"encoders": "motor", "noise": {"sigma": 0.03}, "length_unit": "mm"}
    answer = jointstiff.import_files(table, robot=CAMPAIGN["robot"], **options)
    assert (answer.missing, answer.findings) == ([], [])
    assert {one.force for one in answer.measurement_set.observations} == {(0.0, 0.0, 0.0)}
    read = answer.measurement_set.model_dump(mode="json", exclude_none=True)
    run = jointstiff.identify({"robot": CAMPAIGN["robot"], "measurement_set": read})
    stated = jointstiff.identify(CAMPAIGN)
    assert run.request.weight is not None
    pairs = [
        (one.stiffness, other.stiffness)
        for one, other in zip(run.result.joints, stated.result.joints, strict=True)
    ]
    numbers = [pair for pair in pairs if None not in pair]
    assert len(numbers) >= 3
    assert all(one == pytest.approx(other, rel=1e-6) for one, other in numbers)
    assert all(pair == (None, None) for pair in pairs if None in pair)


@pytest.mark.parametrize(
    "table", [{}, {"joint": "{number}"}, {"joint": "Axis {number}"}, {"bound": "± [kg]", "scale": 1.0}]
)
def test_a_table_of_masses_gives_the_bodies(table):
    answer = import_files(
        sources_of(POSITIONS, masses(**table)), ImportRequest(encoders="motor"), prepared(BARE)
    )
    assert answer.measurement_set is not None
    for body, stated in zip(answer.bodies, CAMPAIGN["robot"]["bodies"], strict=True):
        assert (body.name, body.joint, body.mass) == (stated["name"], stated["joint"], stated["mass"])
        assert body.mass_uncertainty == pytest.approx(stated["mass_uncertainty"], rel=1e-9)
        assert body.centre == pytest.approx(tuple(stated["centre"]), rel=1e-9)
