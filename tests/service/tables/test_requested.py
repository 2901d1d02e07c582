"""What was asked for: fields, units and numbers of any message."""

from __future__ import annotations

import hashlib
import json

import pytest

from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.schemas.plan import PlanRequest
from jointstiff.service.tables.report import requested
from jointstiff.service.tables.table import figure, number, rounded

POSE = {"joints": [10.0, -20.0], "targets": {"P10": (1500.25, 0.0, -0.0)}}


def sweeps(unit, count=4):
    return {
        "units": {"length": unit, "angle": "deg"},
        "noise": {"sigma": 0.01},
        "sweeps": [{"joint": "joint_1", "observations": [POSE] * count}],
        "base": {"by": "axes", "height": 300.0},
    }


def test_units_that_the_request_states_stand_beside_its_numbers():
    said = dict(requested(GeometryRequest.model_validate(sweeps("mm"))))
    assert said["Noise: sigma"] == "0.01 mm"
    assert said["Base: height"] == "300 mm"
    metres = dict(requested(GeometryRequest.model_validate(sweeps("m"))))
    assert metres["Noise: sigma"] == "10 mm"


def test_units_of_the_schema_are_those_of_people():
    plan = {
        "robot_id": "r1",
        "readings": 3,
        "load": {"kind": "dead_weight", "force": 1500.0},
        "load_point": [0.0, 0.05, 0.2],
        "stiffness": {"joint_1": 1.5e6},
        "priors": {"joint_2": {"stiffness": 2e6, "standard_uncertainty": 1e5}},
        "distinct_angle": 0.17453292519943295,
        "elastic_links": True,
    }
    said = dict(requested(PlanRequest.model_validate(plan)))
    assert said["Load: force"] == "1500 N"
    assert said["Load point"] == "(0, 50, 200) mm"
    assert said["Stiffness"] == "joint_1 1.5 10⁶ N·m/rad"
    assert said["Priors"] == "joint_2 stiffness 2 10⁶ N·m/rad, standard uncertainty 0.1 10⁶ N·m/rad"
    assert said["Distinct angle"] == "10°"
    assert said["Elastic links"] == "yes"
    assert "criterion" in said["Not stated"].split(", ")
    named = {label.lower() for label in said} | {*said["Not stated"].split(", ")}
    tops = {label.split(":")[0] for label in named}
    assert {name.replace("_", " ") for name in PlanRequest.model_fields} <= tops


def test_long_readings_are_counted_and_hashed():
    request = GeometryRequest.model_validate(sweeps("mm", 100))
    observations = json.dumps([POSE] * 100, separators=(",", ":"))
    digest = hashlib.sha256(observations.encode()).hexdigest()
    assert dict(requested(request))["Sweeps"] == f"joint joint_1, observations 100 entries, SHA-256 {digest}"


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (1037.4, ".4g", "1037"),
        (1037.4, ".3g", "1040"),
        (-0.0, ".3f", "0.000"),
        (-0.0001, ".2f", "0.00"),
        (-0.51, ".1f", "-0.5"),
        (2.5e7, ".3g", "2.5 · 10⁷"),
        (3e-9, ".3g", "3 · 10⁻⁹"),
        (0.0, ".4g", "0"),
    ],
)
def test_numbers_have_one_format(value, form, text):
    assert figure(value, form) == number(form)(value) == text


def test_a_number_has_two_digits_of_its_uncertainty():
    assert rounded(0.26951, 0.0213) == "0.270"
    assert rounded(-0.0004, 0.02) == "0.000"
    assert rounded(12345.6, 321.0) == "12350"
    assert rounded(None) == "—"
