"""The verdict on what is made of a run: reasons of its own beside those of the run, and one head line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import hypot, isfinite
from typing import Final

from jointstiff.schemas.finding import Assessment, Finding, FindingCode, Verdict, combined
from jointstiff.schemas.run import RunResult

LARGEST_DEFLECTION: Final = 0.02
"""Deflection of an arm beyond which a load or a length is in another unit [m]."""
LARGEST_RATIO: Final = 20.0
"""Deflection relative to the campaign's greatest, beyond which a load or a length is in another unit."""
LONGEST_TOOL: Final = 1.5
"""Distance of a load point or a place from the flange that is usual [m]."""
_SUBJECT: Final[dict[Verdict, str]] = {
    "use": "Use this {}",
    "use_with_care": "Use this {} with care",
    "do_not_use": "Do not use this {}",
}


def own_reason(code: FindingCode, weight: Verdict, message: str, remedy: str) -> Finding:
    """Return a reason of a result."""
    return Finding(code=code, weight=weight, message=message, remedy=remedy)


def judged(subject: str, reasons: Sequence[Finding], run: Assessment | None) -> Assessment:
    """Return the worst verdict of a result and of its run, with a head line that says of what.

    Args:
        subject: name of the result, such as `map`.
        reasons: reasons of its own.
        run: assessment of its run or runs; None without one.
    """
    worst: Verdict = max((each.weight for each in reasons), key=list(_SUBJECT).index, default="use")
    own = Assessment(verdict=worst, reasons=list(reasons))
    whole = combined([own] if run is None else [own, run])
    parts = [f"{_counted(reasons)} of its own"] if reasons else []
    if run is not None and run.reasons:
        parts.append(f"{_counted(run.reasons)} of its run")
    if not parts:
        parts = ["nothing speaks against it" + _support(run)]
    headline = f"{_SUBJECT[whole.verdict].format(subject)}: {', '.join(parts)}"
    return whole.model_copy(update={"headline": headline})


def _counted(reasons: Sequence[Finding]) -> str:
    return f"{len(reasons)} reason{'' if len(reasons) == 1 else 's'}"


def _support(run: Assessment | None) -> str:
    if run is None or run.joints_identified is None:
        return ""
    identified, count = run.joints_identified, run.joint_count
    share = f"all {count}" if identified == count else f"{identified} of {count}"
    return f"; {share} joints of its run passed the checks"


def of_deflection(greatest: float | None, run: RunResult) -> list[Finding]:
    """Return the reason against a deflection [m] that no arm has, or that is far from the campaign's."""
    if greatest is None or not isfinite(greatest):
        return []
    measured = max((hypot(*each.deflection) for each in run.residuals), default=0.0)
    ratio = greatest / measured if measured > 0.0 else 0.0
    if greatest <= LARGEST_DEFLECTION and ratio <= LARGEST_RATIO:
        return []
    beside = f", {ratio:.3g} times the greatest of the campaign" if ratio > 1.0 else ""
    return [
        own_reason(
            "prediction_implausible",
            "do_not_use",
            f"the greatest deflection is {1e3 * greatest:.4g} mm{beside}",
            "check the units of the load and of the points (N or kN, m or mm)",
        )
    ]


def of_points(points: Iterable[Sequence[float] | None]) -> list[Finding]:
    """Return the reason against points on the tool [m, flange frame] that are unusually far."""
    far = max((hypot(*point) for point in points if point is not None), default=0.0)
    if far <= LONGEST_TOOL:
        return []
    message = f"the load point or the place is {far:.3g} m from the flange"
    return [own_reason("point_implausible", "use_with_care", message, "check its unit and its frame")]


def of_campaign(count: int, total: int, what: str) -> list[Finding]:
    """Return the reason that loads or postures are beyond those of the campaign."""
    if not count:
        return []
    message = f"{count} of {total} {what} have loads or postures beyond those of the campaign"
    remedy = "measure with such loads and postures"
    return [own_reason("beyond_campaign", "use_with_care", message, remedy)]


def of_missing(count: int, total: int, what: str, why: str = "") -> list[Finding]:
    """Return the reason that some, or all, have no number."""
    if not count:
        return []
    weight: Verdict = "do_not_use" if count == total else "use_with_care"
    share = f"none of the {total}" if count == total else f"{total - count} of {total}"
    message = f"{share} {what} {'have' if total != 1 else 'has'} a number{f': {why}' if why else ''}"
    remedy = "read the reason of each; measure what twists the joints without a number, or move the places"
    return [own_reason("numbers_missing", weight, message, remedy)]
