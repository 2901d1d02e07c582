"""What a refusal says: its place, its reason, and the remedy."""

from collections.abc import Callable
from typing import Any

import pytest

import jointstiff as js
from jointstiff.solver.errors import JointstiffError


def refused(do: Callable[..., object], *arguments: Any, **options: Any) -> tuple[str, str, str]:
    """Call what the solver or the library is to refuse; return where, why, and the remedy."""
    with pytest.raises((JointstiffError, js.CampaignError)) as caught:
        do(*arguments, **options)
    error = caught.value
    if isinstance(error, js.CampaignError):
        return error.problem.where, error.problem.detail, error.problem.remedy
    return error.where, error.reason, error.remedy


def told(answer: Any) -> tuple[int, str, str, str]:
    """Return the status of a problem over HTTP, where, why, and the remedy."""
    problem = answer.json()
    return answer.status_code, problem["where"], problem["detail"], problem["remedy"]
