"""The resampling of a run, cut into steps of a fraction of a second whose results can be kept."""

from __future__ import annotations

from functools import cached_property
from typing import Final

from jointstiff.schemas.options import Resampling, RunOptions
from jointstiff.service.conversion.prepared import PreparedSet
from jointstiff.service.kinds.run.settings import identified, to_settings
from jointstiff.service.kinds.work import Span
from jointstiff.solver.convex.problem import Bounds
from jointstiff.solver.errors import RequestError
from jointstiff.solver.resampling import (
    GramBlocks,
    Resamples,
    ResamplingPlan,
    blocks_of_identified,
    refuse_nonlinear,
    resample,
)

STEP_SECONDS: Final = 0.25
_SECONDS_A_REPETITION: Final = 8e-6
_SECONDS_A_READING: Final = 2.5e-8
"""Measured on the developers' machine; they decide the size of a step and nothing else."""


class ResamplingWork:
    """The draws of one fit; their blocks are computed once, when the first step asks for them."""

    def __init__(self, prepared: PreparedSet, options: RunOptions, resampling: Resampling) -> None:
        """Check what is asked for.

        Raises:
            RequestError: a draw larger than the set, or what cannot be resampled.
        """
        self._prepared = prepared
        self._settings = to_settings(options, prepared.robot)
        refuse_nonlinear(self._settings)
        self.configurations = len(prepared.measurements)
        if resampling.size > self.configurations:
            raise RequestError(
                f"a draw of {resampling.size} configurations exceeds the set's {self.configurations}",
                where="resampling.size",
                remedy=f"set `size` to at most {self.configurations}",
            )
        self._plan = ResamplingPlan(
            resampling.size, resampling.repetitions, resampling.seed, resampling.replacement
        )

    @cached_property
    def _blocks(self) -> GramBlocks:
        settings, estimate = identified(self._prepared, self._settings)
        return blocks_of_identified(self._prepared.robot, self._prepared.measurements, settings, estimate)

    @property
    def repetitions(self) -> int:
        """Number of draws."""
        return self._plan.repetitions

    def steps(self) -> tuple[Span, ...]:
        """Return the repetitions, cut into steps of about `STEP_SECONDS`."""
        readings = int(self._prepared.measurements.present.sum())
        seconds = _SECONDS_A_REPETITION + _SECONDS_A_READING * readings
        size = max(1, int(STEP_SECONDS / seconds))
        return tuple(
            (start, min(start + size, self.repetitions)) for start in range(0, self.repetitions, size)
        )

    def compute(self, span: Span, bounds: Bounds | None = None) -> Resamples:
        """Fit some of the draws; their numbers do not depend on worker or division.

        Args:
            span: first repetition, and one past the last.
            bounds: on the compliances, instead of those of the options.

        Raises:
            JointstiffError: as the identification of the whole set does.
        """
        return resample(self._blocks, self._plan, self._settings.bounds if bounds is None else bounds, *span)
