"""Methods that `import jointstiff` and `Client` share: one for each kind of work, such as `identify`."""

from __future__ import annotations

from collections.abc import Callable
from types import MethodType
from typing import TYPE_CHECKING, Any

from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.kinds.verb import import_verb

if TYPE_CHECKING:
    from jointstiff.service.kinds.comparison import verb as of_comparison
    from jointstiff.service.kinds.fleet import verb as of_fleet
    from jointstiff.service.kinds.gearbox import verb as of_gearbox
    from jointstiff.service.kinds.geometry import verb as of_geometry
    from jointstiff.service.kinds.map import verb as of_map
    from jointstiff.service.kinds.plan import verb as of_plan
    from jointstiff.service.kinds.process import verb as of_process
    from jointstiff.service.kinds.program import verb as of_program
    from jointstiff.service.kinds.run import verb as of_run


class Verbs:
    """Base class with a method for each kind of work, imported when it is first used."""

    if TYPE_CHECKING:
        identify = of_run.identify
        compare = of_comparison.compare
        geometry = of_geometry.geometry
        gearbox = of_gearbox.gearbox
        plan = of_plan.plan
        map = of_map.map
        fleet = of_fleet.fleet
        compensate = of_program.compensate
        process = of_process.process
    else:

        def __getattr__(self, name: str) -> Callable[..., Any]:
            """Return the function of a kind of work, such as `identify`, as a method."""
            kind = next((kind for kind, room in ROOMS.items() if room.command == name), None)
            if kind is None:
                raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
            return MethodType(import_verb(kind), self)
