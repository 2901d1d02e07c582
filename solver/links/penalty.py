"""Findings about the penalty that cross-validation chose: at an end of its grid, or not certified."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from jointstiff.solver.finding import Finding


def judge_penalty(chosen: float, used: float, grid: Sequence[float]) -> Iterator[Finding]:
    """Report a penalty at an end of its grid, or one that gave way to a larger one.

    Args:
        chosen: weight λ of least held-out residual.
        used: weight of the fit, the first from there on whose optimum is certified.
        grid: ascending weights that were compared.
    """
    if chosen == grid[-1]:
        yield Finding(
            "link_penalty_at_end",
            None,
            f"cross-validation chose the largest penalty of its grid, {chosen:.3g}: held-out readings are "
            "predicted best when hardly any link bends",
            "use elasticity joints; compare the models' held-out compensation in `selection`",
            "note",
        )
    elif chosen == grid[0]:
        yield Finding(
            "link_penalty_at_end",
            None,
            f"cross-validation chose the smallest penalty of its grid, {chosen:.3g}: the readings "
            "hardly need one, and the penalty does not bias the links",
            "give link_penalty to try a smaller one; predictions will hardly change",
            "note",
        )
    if used != chosen:
        yield Finding(
            "link_penalty_raised",
            None,
            f"cross-validation chose a penalty of {chosen:.3g}, whose optimum rounding "
            f"does not let us certify: {used:.3g} was used instead",
            "compare `selection`; give link_penalty, or choose fewer links",
            "note",
        )
