"""All kinds of work, in order: routes, listings, commands, clients, deletion and tests iterate over them."""

from __future__ import annotations

from typing import Final

from jointstiff.service.kinds.comparison import COMPARISON
from jointstiff.service.kinds.geometry import GEOMETRY
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.map import MAP
from jointstiff.service.kinds.pair import PAIR
from jointstiff.service.kinds.plan import PLAN
from jointstiff.service.kinds.program import PROGRAM
from jointstiff.service.kinds.run import RUN

KINDS: Final[tuple[AnyKind, ...]] = (RUN, COMPARISON, PAIR, GEOMETRY, PLAN, MAP, PROGRAM)
