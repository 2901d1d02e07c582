"""Short forms of fields on the command line, stated beside their descriptions; the API does not show them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Terminal:
    """Form of a field on the command line, if its name and type do not determine it."""

    option: str = ""  # name, such as `--prior`; the field's if empty
    metavar: str = ""
    parse: Callable[[str], Any] | None = None  # from text to JSON; raises a ValueError
    gather: Literal["one", "list", "dict"] = "one"  # whether it is repeated, and what becomes of the values
    unit: str = ""  # unit of its numbers as the command line states them to the API: m, deg, N
    hidden: bool = False  # whether the field has no option: it comes from a file of options
    flag: str = ""  # value that the option stands for, if it takes none
    text: str = ""  # help, if the description of the field does not hold on the command line


def prior_of(text: str) -> tuple[str, dict[str, float]]:
    """Return joint and prior of `JOINT=STIFFNESS:UNCERTAINTY`."""
    name, _, numbers = text.rpartition("=")
    stiffness, _, uncertainty = numbers.partition(":")
    try:
        return name, {"stiffness": float(stiffness), "standard_uncertainty": float(uncertainty)}
    except ValueError:
        raise ValueError(
            f"'{text}' must be like joint_5=4e5:4e4: joint, stiffness and standard uncertainty"
        ) from None


def chain_of(text: str) -> list[str]:
    """Return the names of `JOINT,JOINT,...`."""
    return [name.strip() for name in text.split(",")]


def draws_of(text: str) -> dict[str, int]:
    """Return the draws of `SIZE[:REPETITIONS[:SEED]]`."""
    parts, names = text.split(":"), ("size", "repetitions", "seed")
    if len(parts) > len(names) or not all(part.isdecimal() for part in parts):
        raise ValueError(f"'{text}' must be whole numbers, such as 10:1000:1")
    return dict(zip(names, map(int, parts), strict=False))


def planned_load_of(text: str) -> dict[str, Any]:
    """Return the load of `KIND:NEWTONS`, such as `any_direction:1500`; `own_weight` has no size."""
    kind, _, force = text.partition(":")
    if text == "own_weight":
        return {"kind": text}
    try:
        return {"kind": kind, "force": float(force)}
    except ValueError:
        raise ValueError(
            f"'{text}' must be KIND:NEWTONS with the kind dead_weight or any_direction, such as "
            "any_direction:1500"
        ) from None


def force_of(text: str) -> dict[str, list[float]]:
    """Return a load without moment of `X,Y,Z` [N]."""
    return {"force": numbers_of(text)}


def frame_of(text: str) -> dict[str, Any]:
    """Return the frame of `[NAME=]NUMBERS`."""
    name, _, numbers = text.rpartition("=")
    return {"name": name or None, "values": numbers_of(numbers)}


def numbers_of(text: str) -> list[float]:
    """Return numbers that commas or blanks separate."""
    try:
        return [float(number) for number in text.replace(",", " ").split()]
    except ValueError:
        raise ValueError(f"'{text}' must be numbers, such as 0,0,215.5") from None
