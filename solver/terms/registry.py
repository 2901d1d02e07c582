"""Registry of the errors that a set may state, a test suspects, a budget lists and a plan hedges against."""

from __future__ import annotations

from typing import Final

from jointstiff.solver.terms.load import CONSTANT_FORCE, FORCE_DIRECTION, FORCE_SCALE, LOAD_POINT
from jointstiff.solver.terms.places import AXES, MOVEMENT, TARGET_PLACES
from jointstiff.solver.terms.term import Term

TERMS: Final[dict[str, Term]] = {
    term.name: term
    for term in (FORCE_SCALE, FORCE_DIRECTION, LOAD_POINT, CONSTANT_FORCE, MOVEMENT, TARGET_PLACES, AXES)
}
"""Errors by name. Each has its line in the budget where the readings state its uncertainty."""
