"""The mark of a corrected program: a comment that keeps it from a second correction."""

from __future__ import annotations

import re
from datetime import date
from typing import Final

MARK: Final = "Jointstiff run "
"""Text by which a mark is known."""
_HEAD: Final = {
    "krl": re.compile(rb"^[ \t]*+(?:GLOBAL[ \t]++)?DEF(?:FCT)?\b[^\r\n]*+(?:\r\n|\n|\r)", re.M | re.I),
    "rapid": re.compile(rb"^[ \t]*+MODULE\b[^\r\n]*+(?:\r\n|\n|\r)", re.M | re.I),
    "fanuc": re.compile(rb"^/MN[^\r\n]*+(?:\r\n|\n|\r)", re.M),
}
"""Line behind which the mark stands; in other formats it is the first line."""


def marked(kind: str, content: bytes, run_id: str, verdict: str, day: date) -> bytes:
    """Return a corrected program with its mark; FANUC's is two remarks, which hold 32 characters at most."""
    end = b"\r\n" if b"\r\n" in content else b"\n"
    said = f"corrected {day.isoformat()}, verdict: {verdict.replace('_', ' ')}"
    if kind == "fanuc":
        words = f"verdict: {verdict.replace('_', ' ')}"
        remarks = [f"{MARK}{run_id[:8]}", f"corrected {day.isoformat()}", words]
        mark = b"".join(f"    :  !{remark} ;".encode("ascii", "replace") + end for remark in remarks)
    else:
        sign = {"krl": ";", "rapid": "!"}.get(kind, "#")
        mark = f"{sign} {MARK}{run_id} {said}".encode("ascii", "replace") + end
    head = _HEAD[kind].search(content) if kind in _HEAD else None
    place = head.end() if head else 0
    return content[:place] + mark + content[place:]


def mark_line(text: str) -> int | None:
    """Return the line of a program's mark, from 1; None if it has none."""
    place = text.find(MARK)
    return None if place < 0 else len(re.findall(r"\r\n|\n|\r", text[:place])) + 1
