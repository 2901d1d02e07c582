"""Kinds of columns that several steps of a proposal know."""

from __future__ import annotations

from typing import Final

from jointstiff.service.importing.grammar import Kind

LOADS: Final[frozenset[Kind]] = frozenset(("force", "moment", "load point", "mass"))
"""Kinds of columns that are the load of a posture."""
KEPT_KINDS: Final[frozenset[Kind]] = LOADS | {"validation", "time"}
"""Kinds of columns of the table of joints that are kept."""
