"""Units of columns that comments and titles state, such as `Hz [gon], D = slope distance [m]`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from jointstiff.service.importing.grammar import find_any_unit
from jointstiff.service.importing.grid import Remark

_WORDS_AND_UNIT: Final = r"(?![^\W_])[^][(){},;]{0,40}[\[(]\s?([^][()]{1,12})\s?[\])]"
"""Words behind a name, and a unit in brackets."""


def find_unit_of_name(name: str, remarks: Iterable[Remark]) -> str | None:
    """Return the unit in brackets that remarks state behind the name of a column; None unless it is one."""
    pattern = re.compile(rf"(?<![^\W_]){re.escape(name)}{_WORDS_AND_UNIT}")
    known = (find_any_unit(text) for remark in remarks for text in pattern.findall(remark.text))
    units = {unit for unit in known if unit is not None}
    return units.pop()[1] if len(units) == 1 else None
