"""What a refusal says: its place, its reason, and the remedy, in one line."""

from collections.abc import Callable
from typing import Any

import pytest

import jointstiff as js
from jointstiff.solver.errors import JointstiffError


def refused(do: Callable[..., object], *arguments: Any, **options: Any) -> str:
    """Call what the solver or the library is to refuse; return where, why, and the remedy."""
    with pytest.raises((JointstiffError, js.CampaignError)) as caught:
        do(*arguments, **options)
    error = caught.value
    if isinstance(error, js.CampaignError):
        error = error.problem
        return f"{error.where} | {error.detail} | {error.remedy}"
    return f"{error.where} | {error.reason} | {error.remedy}"


def told(answer: Any) -> str:
    """Return the status of a problem over HTTP, where (if it has a place), why, and the remedy."""
    problem = answer.json()
    words = [problem[name] for name in ("where", "detail", "remedy") if problem[name] is not None]
    return " | ".join([str(answer.status_code), *words])
