"""Findings about what cross-validation chose: a penalty at an end, or not certified; the loss."""

from __future__ import annotations

from collections.abc import Iterator

from jointstiff.schemas.finding import Finding
from jointstiff.solver.links.cross_validation import LIMITS, WEIGHTS
from jointstiff.solver.links.losses import MOST_TARGETS


def judge_penalty(chosen: float, used: float) -> Iterator[Finding]:
    """Report a penalty under which no link bends, the least of all, or one that gave way to a larger one.

    Args:
        chosen: weight λ of least held-out residual.
        used: weight of the fit, the first from there on whose optimum is certified.
    """
    if chosen >= WEIGHTS[-1]:
        yield Finding(
            code="link_penalty_at_end",
            weight="use",
            message=(
                f"cross-validation chose a penalty of {chosen:.3g}: held-out readings are predicted best "
                "when "
                "hardly any link bends"
            ),
            remedy="use elasticity joints; compare the models' held-out compensation in `selection`",
        )
    elif chosen <= LIMITS[0]:
        yield Finding(
            code="link_penalty_at_end",
            weight="use",
            message=(
                f"cross-validation chose the smallest penalty that it tries, {chosen:.3g}: the readings "
                "hardly need one, and the penalty does not bias the links"
            ),
            remedy="give link_penalty to try a smaller one; predictions will hardly change",
        )
    if used > chosen:
        yield Finding(
            code="link_penalty_raised",
            weight="use",
            message=(
                f"cross-validation chose a penalty of {chosen:.3g}, but rounding prevents the certificate of "
                f"its optimum: {used:.3g} was used instead"
            ),
            remedy="compare `selection`; give link_penalty, or choose fewer links",
        )


def judge_losses(targets: int) -> Iterator[Finding]:
    """Report that losses were not compared in a set of too many targets."""
    if targets > MOST_TARGETS:
        yield Finding(
            code="loss_not_compared",
            weight="use",
            message=(
                f"loss squared was used: other losses are compared only in sets of at most {MOST_TARGETS} "
                f"targets, and this one has {targets}"
            ),
            remedy=(
                "leave observations out to compare losses; with this many readings the loss matters little"
            ),
        )
