"""Time stamps at the start of the lines of a log, such as `[10:03:10] TRACKER …`: values, and no words."""

from __future__ import annotations

import re
from typing import Final

_DATE: Final = r"(?:\d{4}[-./]\d{1,2}[-./]\d{1,2}|\d{1,2}[-./]\d{1,2}[-./]\d{4})"
_SECONDS: Final = r":\d{2}(?:[.,]\d{1,9})?"
_ZONE: Final = r"(?:Z|[+-]\d{2}:?\d{2}|[ ]?[AaPp][Mm])?"
_DAY_AND_TIME: Final = rf"{_DATE}(?:[T, ]{{1,3}}\d{{1,2}}:\d{{2}}(?:{_SECONDS})?{_ZONE})?"
_TIME_OF_DAY: Final = rf"\d{{1,2}}:\d{{2}}{_SECONDS}{_ZONE}"
_STAMP: Final = re.compile(
    rf"\s{{0,40}}(?P<open>[\[(<])?(?:{_DAY_AND_TIME}|{_TIME_OF_DAY})"
    r"(?(open)[\])>])[:;,|]?(?:\s{1,9}-(?=\s)|(?(open)|(?=\s|$)))\s{0,40}"
)
"""A date, a time with seconds, or both; a clock without seconds may be a ratio."""


def split_time_stamp(line: str) -> tuple[str, str]:
    """Return the time stamp at the start of a line and the rest; an empty stamp of another line."""
    found = _STAMP.match(line)
    end = 0 if found is None else found.end()
    return line[:end], line[end:]
