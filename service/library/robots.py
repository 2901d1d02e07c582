"""Robots as commands name them: a file, or an arm of the catalogue."""

from __future__ import annotations

from pathlib import Path

from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.library.campaigns import read_document
from jointstiff.service.library.errors import CampaignError
from jointstiff.service.problems.table import problem_of
from jointstiff.service.resources.nominal_arms import find_arm, nominal_robot
from jointstiff.solver.errors import RequestError


def read_robot(text: str) -> RobotDocument:
    """Return the robot of a file that has one, or of a campaign; else the nominal arm of that name.

    Args:
        text: path of a file, or name of an arm of the catalogue.

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
