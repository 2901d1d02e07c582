"""Each case answers as expected; numbers of simulated springs are those of the springs."""

import pytest
from support.cases import HERE, Case, cases, changes
from support.shared_data import MISSING

from jointstiff.simulator import default_arm

OF_DEFAULT_ARM = [
    "deflections_exact_places_places_stated",
    "edited_2_postures",
    "encoders_two",
    "exact",
    "few_decoupled_huber_bounds",
    "few_no_sigma_characteristic",
    "few_no_sigma_huber",
    "gauges_two",
    "holes",
    "kilonewtons",
    "offset_wrist",
    "pedestal_base",
    "stated_decoupled",
    "stated_direction_alone",
    "stated_gauges_with_places",
    "stated_left_out",
    "stated_neglected",
    "stated_sigma_thrice",
    "too_few",
    "two_loads_load_scale",
    "vertical",
    "weak_loads",
    "weight_1",
    "weight_1_balancer",
    "weight_1_gravity_estimated",
    "weight_payload",
    "weight_tilted",
]
"""Cases whose readings are of the springs of `default_arm`."""
FURTHEST = 4.0
"""Greatest distance of an estimate from its spring, in standard uncertainties."""


@pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)
def test_a_user_reads_the_expected_numbers_and_codes(case):
    if case.missing:
        pytest.skip(MISSING)
    found = case.differences()
    assert not found, "\n".join(["expected → found", *found])


@pytest.mark.parametrize("name", OF_DEFAULT_ARM)
def test_expected_stiffnesses_are_those_of_the_springs(name):
    """Judge what is expected by truth that shares no code: springs that balance the loads exactly."""
    joints = Case.read(HERE / name).expected["joints"].values()
    for (status, _, stiffness, uncertainty, *_), planted in zip(
        joints, default_arm().stiffnesses, strict=True
    ):
        if status == "identified":
            assert abs(1.0 / stiffness - 1.0 / planted) < FURTHEST * uncertainty


def test_a_changed_number_is_one_readable_line():
    then = {"joints": {"joint_2": ["identified", 2.731e6], "joint_3": ["identified", 1.0e6]}}
    now = {"joints": {"joint_2": ["identified", 2.7401e6], "joint_3": ["identified", 1.0e6]}}
    (line,) = changes(then, now)
    assert line.split() == ["joints.joint_2[1]", "2731000.0", "→", "2740100.0", "(+0.333", "%)"]


def test_a_lost_reason_is_told():
    lines = list(changes({"reasons": ["play: use_with_care"]}, {"reasons": []}))
    assert [line.split("→")[1].strip() for line in lines] == ["[]"]
