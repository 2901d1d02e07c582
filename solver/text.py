"""Numbers, lengths, limits, postures and stiffnesses in words."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, floor, isinf, log10
from typing import Final

from jointstiff.schemas.joints import JOINT_UNITS, JointKind

_RAISED: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def figure(value: float, form: str = ".4g") -> str:
    """Format a number: in full up to a million, beyond by a power of ten, no negative zero."""
    text = format(value, form)
    if "e" in text and 1e-4 <= abs(value) < 1e6:
        text = f"{float(text):.10g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa} · 10{str(int(exponent)).translate(_RAISED)}"
    return text if text.strip("-0.") else text.lstrip("-")


def length_text(length: float) -> str:
    """A length [m] for people, in the unit that suits it."""
    for factor, unit in ((1.0, "m"), (1e3, "mm"), (1e6, "µm")):
        if abs(length) * factor >= 0.9995:  # which is printed as 1
            return f"{figure(length * factor, '.3g')} {unit}"
    return f"{figure(length * 1e9, '.3g')} nm"


def unknowns_text(unit: str, values: Sequence[float]) -> str:
    """Return unknowns of a term for people: shifts [m], then turns [rad], or play [rad], forces, scales."""
    if unit == "m, rad":
        shift, turn = values[:3], values[3:]
        return f"{unknowns_text('m', shift)} and ({_joined(1e6, turn)}) µrad"
    if unit == "m":
        small = max(map(abs, values), default=0.0) < 1e-3
        return f"({_joined(1e6, values)}) µm" if small else f"({_joined(1e3, values)}) mm"
    factor, shown = {"rad": (60.0 * degrees(1.0), "arcmin"), "1": (1e2, "%")}.get(unit, (1.0, unit))
    return f"({_joined(factor, values)}) {shown}"


def _joined(factor: float, values: Sequence[float]) -> str:
    return ", ".join(f"{factor * value:.3g}" for value in values)


def rounded_down(limit: float) -> float:
    """Round a lower limit down to three digits."""
    step = 10.0 ** (floor(log10(limit)) - 2)
    return floor(limit / step) * step


def posture_text(positions: Sequence[float], kinds: Sequence[JointKind], decimals: int = 0) -> str:
    """Return the positions of joints [rad or m] as people read them: (10, -20)°, or (10°, 250 mm)."""
    angles = [f"{degrees(value):.{decimals}f}" for value in positions]
    if "prismatic" not in kinds:
        return f"({', '.join(angles)})°"
    mixed = [
        f"{1e3 * value:.{decimals}f} mm" if kind == "prismatic" else f"{angle}°"
        for value, angle, kind in zip(positions, angles, kinds, strict=True)
    ]
    return f"({', '.join(mixed)})"


def stiffness_text(stiffness: float, kind: JointKind) -> str:
    """Return a stiffness [SI] of a joint of a kind, in the unit that suits it."""
    units, size = JOINT_UNITS[kind], float(f"{abs(stiffness):.3g}")  # as it is printed
    plain = units.stiffness.replace(".", "·")
    if size >= 1e9:
        return f"{'∞' if isinf(size) else figure(stiffness, '.3g')} {plain}"
    if size >= 1e4:
        return f"{stiffness / 1e6:.3g} {'' if kind == 'prismatic' else '· '}{units.million_stiffness}"
    return f"{stiffness:.4g} {plain}"
