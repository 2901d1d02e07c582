"""Plans from files: of a robot, or of a campaign to go on with, and the campaign file to fill in."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.plan import Plan, PlannedReading
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.library.campaigns import read_document
from jointstiff.service.library.errors import CampaignError
from jointstiff.service.problems.table import problem_of
from jointstiff.service.resources.nominal_arms import find_arm, nominal_robot
from jointstiff.solver.errors import RequestError


def read_planned(text: str) -> RobotDocument | Campaign:
    """Read a robot, or a campaign.

    Raises:
        CampaignError: the file is too large, or neither; there is no such file, and no such arm.
    """
    path = Path(text)
    if not path.is_file():
        return read_robot(text)
    try:
        is_campaign = "measurement_set" in json.loads(path.read_bytes())
    except (ValueError, TypeError):
        is_campaign = True  # whose reader says what is wrong
    return read_document(path, Campaign) if is_campaign else read_document(path, RobotDocument)


def campaign_to_fill_in(source: RobotDocument | Campaign, found: Plan) -> dict[str, Any]:
    """Return a campaign file with the planned readings, whose positions are still null."""
    options, robot = found.request, source.robot if isinstance(source, Campaign) else source
    result = found.result
    measured: dict[str, Any] = {"encoders": "motor"}
    if isinstance(source, Campaign):
        measured = {"encoders": source.measurement_set.encoders}
    sigma = {} if options.sigma is None else {"noise": {"sigma": options.sigma}}
    targets = {} if result is None else result.targets
    if options.directions:
        measured["flange_targets"] = targets
    observations = [
        {
            "label": each.label,
            "joints": each.joints,
            "force": each.force,
            "readings": [{"target": target, **_unread(each)} for target in targets],
        }
        for each in ([] if result is None else result.readings)
    ]
    return {
        "robot": robot.model_dump(mode="json", exclude_none=True),
        "measurement_set": {
            "name": f"planned for {robot.name}"[:200],
            "units": {"length": "m", "angle": "rad", "force": "N"},
            **measured,
            **sigma,
            "load_point": (0.0, 0.0, 0.0) if result is None else result.load_point,
            "observations": observations,
        },
        "run": {"method": "partial_pose"},
    }


def _unread(planned: PlannedReading) -> dict[str, Any]:
    """Return the fields of a reading that is still to be taken."""
    if planned.direction is not None:
        return {"displacement": None, "direction": planned.direction}
    return {"unloaded": None, "loaded": None}


def read_robot(text: str) -> RobotDocument:
    """Return the robot of a file that has one, or of a campaign; else the nominal arm of that name.

    Raises:
        CampaignError: the file is neither; or there is no such file, and no such arm.
    """
    if Path(text).is_file():
        return read_document(Path(text), RobotDocument, section="robot")
    try:
        return nominal_robot(find_arm(text, "--robot"))
    except RequestError as error:
        problem = problem_of(error)
        detail = f"there is no file '{text}', and {problem.detail}"
        raise CampaignError(problem.model_copy(update={"detail": detail})) from error
