"""Methods that `import jointstiff` and `Client` share: one for each kind of work, such as `identify`."""

from __future__ import annotations

from collections.abc import Callable
from types import MethodType
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.kinds.verb import import_verb

if TYPE_CHECKING:
    from jointstiff.service.kinds.comparison import verb as of_comparison
    from jointstiff.service.kinds.correction import verb as of_correction
    from jointstiff.service.kinds.gearbox import verb as of_gearbox
    from jointstiff.service.kinds.geometry import verb as of_geometry
    from jointstiff.service.kinds.map import verb as of_map
    from jointstiff.service.kinds.plan import verb as of_plan
    from jointstiff.service.kinds.run import verb as of_run
    from jointstiff.service.kinds.verb import Backend
    from jointstiff.service.library.results import (
        TabledComparison,
        TabledGearbox,
        TabledGeometry,
        TabledMap,
        TabledPlan,
        TabledRun,
    )

    Arguments = ParamSpec("Arguments")
    Result = TypeVar("Result")

    def _presenting(
        verb: Callable[Concatenate[Backend, Arguments], object], result: type[Result]
    ) -> Callable[Concatenate[Any, Arguments], Result]:
        """Return a verb as a method that returns its result with tables, plots and files."""


class Verbs:
    """Base class with a method for each kind of work, imported when it is first used."""

    if TYPE_CHECKING:
        identify = _presenting(of_run.identify, TabledRun)
        compare = _presenting(of_comparison.compare, TabledComparison)
        geometry = _presenting(of_geometry.geometry, TabledGeometry)
        gearbox = _presenting(of_gearbox.gearbox, TabledGearbox)
        plan = _presenting(of_plan.plan, TabledPlan)
        map = _presenting(of_map.map, TabledMap)
        correct = _presenting(of_correction.correct, Any)
    else:

        def __getattr__(self, name: str) -> Callable[..., Any]:
            """Return the function of a kind of work, such as `identify`, as a method."""
            kind = next((kind for kind, room in ROOMS.items() if room.command == name), None)
            if kind is None:
                raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
            return MethodType(import_verb(kind), self)
