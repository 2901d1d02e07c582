"""What was asked for: fields, units and numbers of any message."""

import hashlib
import json

import pytest

from jointstiff.schemas.geometry import GeometryRequest
from jointstiff.service.tables.report import requested
from jointstiff.service.tables.table import number, rounded
from jointstiff.solver.text import figure


def sweeps(unit, count=4):
    return {
        "units": {"length": unit, "angle": "deg"},
        "noise": {"sigma": 0.01},
        "sweeps": [{"joint": "joint_1", "observations": [POSE] * count}],
        "base": {"by": "axes", "height": 300.0},
    }


POSE = {"joints": [10.0, -20.0], "targets": {"P10": (1500.25, 0.0, -0.0)}}


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


def test_long_readings_are_counted_and_hashed():
    request = GeometryRequest.model_validate(sweeps("mm", 100))
    observations = json.dumps([POSE] * 100, separators=(",", ":"))
    digest = hashlib.sha256(observations.encode()).hexdigest()
    assert dict(requested(request))["Sweeps"] == f"joint joint_1, observations 100 entries, SHA-256 {digest}"
