"""Units of columns that comments and titles state, such as `Hz [gon], V [gon], D [m]` or `forces in kN`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import chain
from typing import Final

from jointstiff.service.importing.grammar import WORDS_OF_FORCE, find_any_unit, find_known_unit
from jointstiff.service.importing.grid import Remark

_WORDS_AND_UNIT: Final = r"(?![^\W_])[^][(){},;]{0,40}[\[(]\s?([^][()]{1,12})\s?[\])]"
"""Words behind a name, and a unit in brackets."""

_FORCE: Final = rf"(?<![^\W\d_])(?:{WORDS_OF_FORCE})(?![^\W_])"
_UNITS_OF_FORCE: Final = (
    re.compile(
        rf"{_FORCE}(?: [^\W\d_]{{1,20}}){{0,3}} ?[\[(（［] ?([^\W\d_]{{1,12}}) ?[\])）］]", re.IGNORECASE
    ),
    re.compile(
        rf"{_FORCE}(?: ?[:=]| in| en| em| w| v| в)? ([^\W\d_]{{1,12}})(?![\w/²]|[.·*]\w)", re.IGNORECASE
    ),
)
"""A word for a force, with its unit in brackets behind few words, or without words, as in `forces in kN`."""


def find_unit_of_forces(remarks: Iterable[Remark]) -> str | None:
    """Return the unit that remarks state of forces, such as `Kräfte [N]`; None unless it is one."""
    units = set[str]()
    for remark in remarks:
        for text in chain.from_iterable(pattern.findall(remark.text) for pattern in _UNITS_OF_FORCE):
            known = find_known_unit(text)
            if known is not None and known[0] == "force":
                units.add(known[1])
    return units.pop() if len(units) == 1 else None


def find_unit_of_name(name: str, remarks: Iterable[Remark]) -> str | None:
    """Return the unit in brackets that remarks state behind the name of a column; None unless it is one."""
    pattern = re.compile(rf"(?<![^\W_]){re.escape(name)}{_WORDS_AND_UNIT}")
    known = (find_any_unit(text) for remark in remarks for text in pattern.findall(remark.text))
    units = {unit for unit in known if unit is not None}
    return units.pop()[1] if len(units) == 1 else None
