"""Budget of a search: fits of interpretations, and seconds of processor time."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Final

FITS_OF_REFINEMENT: Final = 1_000
"""Cost of one refined interpretation, in screened ones."""


class BudgetExceeded(Exception):  # noqa: N818 - no error of the data: a person states what the columns are
    """A search that has spent its budget."""


@dataclass
class Budget:
    """Fits and processor time that are left for one or several searches."""

    fits: int = 1_500_000
    seconds: float = 60.0
    _start: float = field(default_factory=time.process_time)

    def spend(self, fits: int = 0) -> None:
        """Count fits, and look at the time.

        Raises:
            BudgetExceeded: nothing is left.
        """
        self.fits -= fits
        if self.fits < 0 or time.process_time() - self._start > self.seconds:
            raise BudgetExceeded
