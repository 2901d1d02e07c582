"""Groups of arrays that only some sets have: stored beside the others under a prefix of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class ArrayGroup:
    """Arrays of N observations; a subclass's fields are their names."""

    prefix: ClassVar[str]

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays by the names under which they are stored."""
        return {f"{self.prefix}{field.name}": getattr(self, field.name) for field in fields(self)}

    @classmethod
    def from_archive(cls, archive: Mapping[str, npt.NDArray[np.generic]]) -> Self | None:
        """Read them back; None for a set without."""
        names = [f"{cls.prefix}{field.name}" for field in fields(cls)]
        return cls(*(archive[name] for name in names)) if names[0] in archive else None
