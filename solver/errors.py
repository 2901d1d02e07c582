"""Every failure of the numerical core, arranged by what the caller can do about it.

    JointstiffError
    ├── InputError                 mend the input
    │   ├── RobotError             ... the robot's description
    │   └── MeasurementError       ... the measurement set
    ├── RequestError               ask for something else
    │   ├── CasesError             ... or without the load cases that fail
    │   └── UnsupportedMethodError ... another method or weighting: the readings cannot support this one
    ├── NotObservableError         measure more: no joint can be determined from these readings
    └── SolverError                nobody's input is wrong: report it with the data

All of them carry `where` (a path into the input, or None), `reason` and `remedy` as data, so that no one
needs to parse a message.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


class JointstiffError(Exception):
    """Failure with its reason, its remedy, and the place in the input where it happened (None if unknown)."""

    def __init__(self, reason: str, *, remedy: str, where: str | None = None) -> None:
        super().__init__(reason, remedy, where)
        self.reason = reason
        self.remedy = remedy
        self.where = where

    def __reduce__(self) -> tuple[object, ...]:
        """Return how pickle restores the error: a function, its arguments, and the attributes to set.

        Without this method pickle would call the constructor without its keyword arguments, and fail.
        """
        return _rebuild_error, (type(self), self.args), vars(self)

    def __str__(self) -> str:
        """Return the place in the input, the reason and the remedy as one sentence."""
        place = f"{self.where}: " if self.where else ""
        return f"{place}{self.reason}; {self.remedy}"


def _rebuild_error(kind: type[JointstiffError], arguments: tuple[object, ...]) -> JointstiffError:
    """Create an error of a class without calling its constructor; pickle then sets the attributes."""
    return kind.__new__(kind, *arguments)


class InputError(JointstiffError):
    """The input is wrong: it contradicts itself or physics."""


class RobotError(InputError):
    """The robot's description cannot be used."""


class MeasurementError(InputError):
    """The measurement set cannot be used."""


class RequestError(JointstiffError):
    """The request cannot be carried out, such as a bound on a joint that the robot does not have."""


class CasesError(RequestError):
    """Some load cases cannot be computed; the others can.

    Attributes:
        failed: (B,) mask of the load cases that fail; there may be more among the others.
        cause: the load is too great for the model, it twists a joint that the readings do not determine, or
            no posture reaches the place.
    """

    def __init__(
        self,
        reason: str,
        *,
        remedy: str,
        failed: npt.NDArray[np.bool_],
        cause: Literal["overloaded", "unseen_joint", "not_reached"],
        where: str | None = None,
    ) -> None:
        first = int(failed.argmax())
        super().__init__(reason, remedy=remedy, where=f"cases[{first}]" if where is None else where)
        self.failed, self.cause = failed, cause


class UnsupportedMethodError(RequestError):
    """The readings or the robot cannot support the method or weighting that was requested."""


class NotObservableError(JointstiffError):
    """The readings determine no joint at all."""


class SolverError(JointstiffError):
    """The convex solver or its certificate failed on data that passed every check."""

    def __init__(
        self,
        reason: str,
        *,
        remedy: str = "please report this problem, with the data",
        where: str | None = None,
    ) -> None:
        super().__init__(reason, remedy=remedy, where=where)
