"""Names that a row of a table has: its observation, target, state and load."""

from __future__ import annotations

from typing import NamedTuple

from jointstiff.schemas.imports import State


class RowName(NamedTuple):
    """Names of a row of a table; None or empty for what the row does not name."""

    label: str | None = None  # name of the observation
    target: str | None = None
    state: State | None = None
    mass: float | None = None  # of the load in the row [kg]
    force: str = ""  # size and unit of the force in the row, if rows have several; else empty

    @property
    def key(self) -> tuple[str | None, State | None, float | None, str]:
        """Names that distinguish the rows of an observation."""
        return self.target, self.state, self.mass, self.force
