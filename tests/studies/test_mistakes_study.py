"""The study of planted mistakes: each is named in campaigns of many kinds."""

from __future__ import annotations

import pytest

from benchmarks.campaigns import default_robot
from benchmarks.studies import integrity
from benchmarks.studies.mistakes import MISTAKES
from jointstiff.simulator import default_arm

pytestmark = pytest.mark.slow  # the studies of benchmarks/, each night


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.name)
def test_mistakes_in_campaigns_of_many_kinds_are_named(mistake):
    robot = default_robot(default_arm())
    assert integrity.found(robot, mistake, 6, deflections=False, first=70_000).missed == []
