"""Details of a run: goodness of the fit, force, K_c, suspicious readings, observability."""

from __future__ import annotations

from collections.abc import Iterator

from jointstiff.schemas.run.identifiability import Identifiability
from jointstiff.schemas.run.run import RunResult
from jointstiff.service.tables.table import Line

_SIGMA = {
    "consistent": "consistent with sigma",
    "residuals_too_large": "residuals larger than sigma predicts",
    "residuals_too_small": "residuals smaller than sigma predicts",
}


def detail_lines(result: RunResult) -> list[Line]:
    """Return the lines that `--details` adds below the table of joints."""
    lines = [Line(f"  {line}", "care") for line in _suspicious(result)]
    others = (
        *_goodness(result),
        *_budget(result),
        *_complementary_stiffness(result),
        *_identifiability(result.identifiability),
    )
    return [*lines, *(Line(f"  {line}", "dim") for line in others)]


def _goodness(result: RunResult) -> Iterator[str]:
    goodness = result.goodness
    if goodness.sigma_source == "given" and goodness.degrees_of_freedom > 0:
        ratio = goodness.chi_square / goodness.degrees_of_freedom
        verdict = f": {_SIGMA[goodness.test.verdict]}" if goodness.test else ""
        yield (
            f"χ²/dof {ratio:.2f}{verdict} (1 if model and sigma are right; "
            f"{goodness.degrees_of_freedom:.4g} degrees of freedom)"
        )


_SOURCES = {
    "readings": "readings",
    "force_scale": "scale of the force",
    "force_direction": "direction of the force",
    "load_point": "load point",
    "target_places": "places of the targets",
    "axes": "axes of the robot's model",
    "model_error": "model error",
    "complementary_stiffness": "neglected K_c",
}


def _range(values: list[float]) -> str:
    ends = sorted({f"{min(values):.2g}", f"{max(values):.2g}"}, key=float)
    return " to ".join(ends)


def _budget(result: RunResult) -> Iterator[str]:
    """Yield what the joints' uncertainties consist of, relative to the compliance."""
    budget = result.budget
    if budget is None:
        return
    sizes = [joint.compliance for joint in result.joints if joint.name in budget.joints]
    for part in budget.components:
        shares = [100 * u / abs(c) for u, c in zip(part.contributions, sizes, strict=True) if c]
        if shares:
            beside = "" if part.included else ", not in the intervals"
            yield (
                f"uncertainty from {_SOURCES[part.source]} (type {part.evaluation}{beside}): "
                f"{_range(shares)} % of a compliance"
            )


def _complementary_stiffness(result: RunResult) -> Iterator[str]:
    """Yield whether it matters that the load follows the deflection."""
    size = result.complementary_stiffness
    if size is None:
        return
    shift = "" if size.largest_shift is None else f" by at most {size.largest_shift:.2g} std. uncertainties"
    verb = (
        f"included ({size.iterations} refit{'s' if size.iterations > 1 else ''}); it changes"
        if size.included
        else "neglected; including it changes"
    )
    yield f"complementary stiffness {verb} a compliance{shift} (K_c/k at most {size.largest_ratio:.2g})"


def _suspicious(result: RunResult) -> Iterator[str]:
    """Yield the readings that the robust loss mistrusts, worst first."""
    robust = result.robust
    if robust is None:
        return
    yield (
        f"Huber loss, threshold {robust.threshold:g} sigma: {robust.suspicious_count} suspicious "
        f"reading{'' if robust.suspicious_count == 1 else 's'}"
    )
    for reading in robust.suspicious:
        yield (
            f"{reading.observation}, {reading.target}: residual of {reading.residual_norm:.3g} sigma, "
            f"weight {reading.weight:.2g}"
        )
    hidden = robust.suspicious_count - len(robust.suspicious)
    if hidden > 0:
        yield f"and {hidden} more"


def _identifiability(found: Identifiability) -> Iterator[str]:
    """Yield the observability of the joints."""
    if found.observability is not None and found.condition_number is not None:
        indices = ", ".join(f"{name.upper()} {value:.2g}" for name, value in found.observability)
        yield f"observability {indices}; condition number {found.condition_number:.3g}"
    yield from found.weakest
