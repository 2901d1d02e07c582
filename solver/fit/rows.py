"""Rows of a campaign: the only way from fits and their evidence to the mechanics (method.md §13)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.fit.stack import Stack
from jointstiff.solver.mechanics.block import (
    BLOCK_LENGTH,
    BlockRows,
    RegressorBlock,
    Term,
    build_rows,
    get_whole_block,
    regressor_blocks,
)
from jointstiff.solver.mechanics.measurements import Measurements, Scatter
from jointstiff.solver.mechanics.robot import Robot


@dataclass(frozen=True, eq=False)
class Rows:
    """Readings of N observations as rows of least-squares problems, at one linearisation.

    Kinematics and columns of sets of one block are computed once and kept; those of large sets are computed
    block by block, so that memory stays flat.
    """

    robot: Robot  #: n joints
    measurements: Measurements  #: N observations
    #: (n,) compliances with which the loads are in balance [rad/(N·m)]; None neglects the complementary
    #: stiffness
    balanced: FloatArray | None = None
    prepared: RegressorBlock | None = None  #: kinematics and regressors, where they are known already
    independent: Measurements | None = None  #: the same readings before they got other sizes of shared errors

    def __len__(self) -> int:
        return len(self.measurements.joints)

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled: the fields alone, as another process computes the kinematics again."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def __getitem__(self, observations: IndexArray | slice) -> Rows:
        """Return the rows of some observations."""
        return self.of(self.measurements[observations])

    def at(self, balanced: FloatArray | None) -> Rows:
        """Return the rows with the loads in balance at other compliances (n,) [rad/(N·m)]."""
        if balanced is None and self.balanced is None:
            return self
        return Rows(self.robot, self.measurements, balanced, independent=self.independent)

    def of(self, measurements: Measurements) -> Rows:
        """Return the rows of other measurements with the same robot, at the same linearisation."""
        if measurements is self.measurements:
            return self
        return Rows(self.robot, measurements, self.balanced)

    def with_scatter(self, scatter: Scatter) -> Rows:
        """Return the rows of the same readings, with other sizes of the errors that a posture shares.

        The kinematics are the same, so that they are not computed again if the set fits into one block.
        """
        measurements = replace(self.measurements, scatter=scatter)
        if self.prepared is not None:
            prepared = replace(self.prepared, measurements=measurements)
            return Rows(self.robot, measurements, self.balanced, prepared)
        independent = self.measurements if self.independent is None else self.independent
        return Rows(self.robot, measurements, self.balanced, independent=independent)

    def select_evenly(self, most: int) -> Rows:
        """Return the rows of at most so many observations, evenly spread over the set."""
        if len(self) <= most:
            return self
        return self.of(self.measurements.select_evenly(most))

    @cached_property
    def block(self) -> RegressorBlock:
        """Kinematics and regressors of all observations.

        Raises:
            SolverError: a load has no balance.
        """
        if self.prepared is not None:
            return self.prepared
        return get_whole_block(self.robot, self.measurements, self.balanced, self.independent)

    def generate_blocks(self) -> Iterator[RegressorBlock]:
        """Yield the kinematics and regressors of the observations, some thousand observations at a time.

        Raises:
            SolverError: a load has no balance.
        """
        if self.prepared is not None:
            return iter([self.prepared])
        if len(self) <= BLOCK_LENGTH:
            return iter([self.block])
        return regressor_blocks(self.robot, self.measurements, self.balanced)

    def generate(
        self, terms: Sequence[Term], compliance: FloatArray, *, whitened: bool = True
    ) -> Iterator[BlockRows]:
        """Yield the rows [A d] of least-squares problems ``A x ≈ d``, some thousand observations at a time.

        Args:
            terms: effects that may have moved the targets; each has a column of A for each unknown.
            compliance: (n,) joint compliances at which the columns of errors are computed [rad/(N·m)].
            whitened: True to scale the rows, so that the noise of each row has variance sigma²; False for
                rows in metres and radians.

        Raises:
            SolverError: a load has no balance.
        """
        for block in self.generate_blocks():
            rows = build_rows(block, terms, compliance)
            yield rows.whiten() if whitened else rows

    def stack(self, terms: Sequence[Term], compliance: FloatArray, *, whitened: bool = True) -> Stack:
        """Stack the rows [A d] of the targets and encoders of all observations.

        Arguments and errors are those of `generate`. Rows of encoders that are not whitened are multiplied by
        a lever [m], so that all rows are in metres: at this distance from the axis, a target determines the
        joint's angle as precisely as the encoder does.
        """
        rows = list[FloatArray]()
        counts_of_readings = list[IndexArray]()
        widths = dict[str, int]()  # number of columns of each term, the same in all blocks
        for block_rows in self.generate(terms, compliance, whitened=whitened):
            if block_rows.encoders is not None and not whitened:
                lever = block_rows.block.measurements.encoder_lever
                block_rows = block_rows._replace(encoders=lever * block_rows.encoders)
            rows.append(block_rows.flat)
            counts_of_readings.append(block_rows.read)
            widths = block_rows.widths
        return Stack(np.concatenate(rows), np.concatenate(counts_of_readings), widths)
