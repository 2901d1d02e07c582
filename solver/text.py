"""Texts of numbers, lengths, limits, postures and stiffnesses for people."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, floor, isinf, log10
from typing import Final

from jointstiff.schemas.joints import JOINT_UNITS, JointKind

PAST_DO_NOT_USE: Final = (
    "if the numbers are right, state `accept_verdict` in each map, program, plan or export of the run"
)
PAST_CARE: Final = "if the numbers are right, use the result with care"
"""How to go past a limit of plausibility, by the verdict of its finding: ends of remedies."""
_SUPERSCRIPTS: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def figure(value: float, form: str = ".4g") -> str:
    """Format a number for people: in full between 0.0001 and a million, else with a power of ten.

    Zero is never printed with a minus sign.
    """
    text = format(value, form)
    if "e" in text and 1e-4 <= abs(value) < 1e6:
        text = f"{float(text):.10g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa} · 10{str(int(exponent)).translate(_SUPERSCRIPTS)}"
    return text if text.strip("-0.") else text.lstrip("-")  # "-0.00" becomes "0.00"


def length_text(length: float) -> str:
    """Format a length [m] for people, in m, mm, µm or nm, whichever suits the size."""
    for factor, unit in ((1.0, "m"), (1e3, "mm"), (1e6, "µm")):
        if abs(length) * factor >= 0.9995:  # 0.9995 is printed as 1
            return f"{figure(length * factor, '.3g')} {unit}"
    return f"{figure(length * 1e9, '.3g')} nm"


_SHOWN_UNITS: Final = {
    "rad": (60.0 * degrees(1.0), "arcmin"),
    "1": (1e2, "%"),
    "m/m": (1e6, "µm/m"),
    "m/N": (1e9, "µm/kN"),
    "rad/(N·m)": (1e6, "µrad/(N·m)"),
}
"""Unit of unknowns → factor and unit in which people read them."""


def unknowns_text(unit: str, values: Sequence[float]) -> str:
    """Format fitted unknowns with their unit for people, such as "(12, -3) µm".

    Args:
        unit: SI unit of the values; "m, rad" for three shifts and then three turns, "1" for relative scales.
        values: the fitted unknowns in that unit.
    """
    if unit == "m, rad":
        shift, turn = values[:3], values[3:]
        return f"{unknowns_text('m', shift)} and ({_join_scaled(1e6, turn)}) µrad"
    if unit == "m":
        in_micrometres = max(map(abs, values), default=0.0) < 1e-3
        return f"({_join_scaled(1e6, values)}) µm" if in_micrometres else f"({_join_scaled(1e3, values)}) mm"
    if unit == "m/N, rad/(N·m)":
        by_force, by_moment = values
        return f"{unknowns_text('m/N', [by_force])} and {unknowns_text('rad/(N·m)', [by_moment])}"
    factor, shown_unit = _SHOWN_UNITS.get(unit, (1.0, unit))
    return f"({_join_scaled(factor, values)}) {shown_unit}"


def _join_scaled(factor: float, values: Sequence[float]) -> str:
    """Return values, multiplied by a factor, as text separated by commas."""
    return ", ".join(f"{factor * value:.3g}" for value in values)


_MOST_RUNS: Final = 20
"""Greatest number of runs of labels that a sentence names."""
_MOST_NAMES: Final = 30
"""Greatest number of single labels that a sentence names."""


def list_labels(labels: Sequence[str], rows: Sequence[int]) -> str:
    """Return the labels of rows in increasing order, such as 'c03', 'c11' to 'c19'; runs are joined.

    Args:
        labels: labels of all rows.
        rows: indices of the rows, at least one.
    """
    runs: list[list[int]] = []
    for row in rows:
        if runs and row == runs[-1][-1] + 1:
            runs[-1].append(row)
        else:
            runs.append([row])
    texts = []
    for run in runs[:_MOST_RUNS]:
        first, last = f"'{labels[run[0]]}'", f"'{labels[run[-1]]}'"
        texts.append({1: first, 2: f"{first}, {last}"}.get(len(run), f"{first} to {last}"))
    further = sum(len(run) for run in runs[_MOST_RUNS:])
    return ", ".join(texts) + (f" and {further} more" if further else "")


def describe_others(observations: Sequence[str | None]) -> str:
    """Return the end of a sentence on further findings of a kind; empty if there are none.

    `observations` are the labels of the observations of these findings; None for the whole set.
    """
    if not observations:
        return ""
    names = [f"'{label}'" for label in dict.fromkeys(observations) if label is not None]
    named = ", ".join(names[:_MOST_NAMES])
    further = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f" (and {len(observations)} more of this kind{f': {named}{further}' if names else ''})"


def round_down(limit: float) -> float:
    """Round a positive number down to three significant digits, so that a lower limit stays a lower limit."""
    step = 10.0 ** (floor(log10(limit)) - 2)
    return floor(limit / step) * step


def posture_text(positions: Sequence[float], kinds: Sequence[JointKind], decimals: int = 0) -> str:
    """Format joint positions [rad or m] for people: (10, -20)°, or (10°, 250 mm) with prismatic joints."""
    angles = [f"{degrees(value):.{decimals}f}" for value in positions]
    if "prismatic" not in kinds:
        return f"({', '.join(angles)})°"
    mixed = [
        f"{1e3 * value:.{decimals}f} mm" if kind == "prismatic" else f"{angle}°"
        for value, angle, kind in zip(positions, angles, kinds, strict=True)
    ]
    return f"({', '.join(mixed)})"


def stiffness_text(stiffness: float, kind: JointKind) -> str:
    """Format a stiffness for people, with a suitable unit: [N·m/rad], or [N/m] of a prismatic joint."""
    units, size = JOINT_UNITS[kind], float(f"{abs(stiffness):.3g}")  # rounded as in the text
    plain = units.stiffness.replace(".", "·")
    if size >= 1e9:
        return f"{'∞' if isinf(size) else figure(stiffness, '.3g')} {plain}"
    if size >= 1e4:
        return f"{stiffness / 1e6:.3g} {'' if kind == 'prismatic' else '· '}{units.million_stiffness}"
    return f"{stiffness:.4g} {plain}"


def lower_limit_texts(
    greatest_compliances: Sequence[float], kinds: Sequence[JointKind], confidence: float
) -> list[str]:
    """Format the lower limits of the stiffnesses of joints, as "stiffer than … at 95 %: ".

    Args:
        greatest_compliances: positive upper limit of the compliance of each joint [rad/(N·m)].
        kinds: kind of each joint.
        confidence: confidence of each limit.
    """
    texts = list[str]()
    for compliance, kind in zip(greatest_compliances, kinds, strict=True):
        stiffness = stiffness_text(round_down(1.0 / compliance), kind)
        texts.append(f"stiffer than {stiffness} at {100 * confidence:g} %: ")
    return texts
