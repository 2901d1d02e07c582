"""One count of the joints that a result has: those with a stiffness that has an upper end."""

import pytest

import jointstiff
from jointstiff.schemas.run import count_identified_joints
from jointstiff.simulator import default_arm, simulate_campaign

CAMPAIGN = simulate_campaign(default_arm(), configurations=12, load="dead_weight", seed=2)
"""Its weight never twists joint 1."""


@pytest.mark.parametrize(
    "options",
    [
        {"elasticity": "joints"},
        {"elasticity": "joints", "stiffness_bounds": {"joint_2": [1e6, 2.5e6], "joint_5": [3e5, None]}},
        {"elasticity": "joints", "positive": False},
        {"elasticity": "diagonal_links", "cross_validation": {"folds": 3, "draws": 1}, "loss": "squared"},
    ],
)
def test_verdict_and_list_count_the_joints_that_have_a_stiffness_with_an_upper_end(options):
    result = jointstiff.identify(CAMPAIGN, **options).result
    ends = [joint.stiffness_interval for joint in result.joints if joint.stiffness is not None]
    bounded = sum(end is not None and end[1] is not None for end in ends)
    assert count_identified_joints(result.joints) == bounded
    assert 1 <= bounded < 6
    assert (
        result.assessment.joints_identified
        == result.summary.joints_identified
        == count_identified_joints(result.joints)
    )


def test_a_joint_without_an_upper_end_is_not_counted():
    result = jointstiff.identify(CAMPAIGN, elasticity="joints").result
    joint = next(one for one in result.joints if one.stiffness_interval is not None)
    open_above = joint.model_copy(update={"stiffness_interval": (joint.stiffness_interval[0], None)})
    assert (count_identified_joints([joint]), count_identified_joints([open_above])) == (1, 0)
