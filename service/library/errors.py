"""Errors of use from Python; each carries a problem, as the API would answer it."""

from __future__ import annotations

from jointstiff.schemas.finding import Problem


class ProblemError(Exception):
    """An error with its problem; its text says what is wrong, where, and how to mend it."""

    def __init__(self, problem: Problem) -> None:
        place = f"{problem.where}: " if problem.where and problem.where not in problem.detail else ""
        remedy = f"; remedy: {problem.remedy}" if problem.remedy else ""
        super().__init__(f"{place}{problem.detail}{remedy}")
        self.problem = problem  #: as the API would answer it


class CampaignError(ProblemError):
    """A campaign that cannot be identified."""


class RefusedError(ProblemError):
    """The service refused, or did not answer."""


class AwayError(RefusedError):
    """The service does not answer now, and may later."""
