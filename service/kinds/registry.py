"""All kinds of work, in order: routes, listings, commands, clients, deletion and tests iterate over them."""

from __future__ import annotations

from typing import Final

from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.rooms import ROOMS, import_kind

KINDS: Final[tuple[AnyKind, ...]] = tuple(map(import_kind, ROOMS))
