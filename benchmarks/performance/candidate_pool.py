"""Candidate readings for benchmarks of plans: random postures under random pulls, three targets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.campaigns import large_campaign
from benchmarks.performance.peers import stacked_rows
from jointstiff.simulator import default_arm
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.optimum import AOptimality, Candidates, DesignProblem, DOptimality

__all__ = ["CRITERIA", "READINGS", "Pool"]

READINGS = 20
CRITERIA = ("D", "relative A", "I")
_BLOCK = 50_000


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates: random postures under random pulls, three targets.

    Attributes:
        rows: (N, 9, 6) whitened, of relative compliances.
        joints: (N, 6) [rad].
    """

    rows: FloatArray
    joints: FloatArray

    @classmethod
    def of(cls, count: int) -> Pool:
        """Draw candidates."""
        campaign = large_campaign(count)
        rows = np.empty((count, 9, 6))
        for start in range(0, count, _BLOCK):
            part = campaign.measurements[start : start + _BLOCK]
            rows[start : start + _BLOCK] = stacked_rows(campaign.robot, part)[0].reshape(-1, 9, 6)
        rows *= default_arm().compliances
        return cls(rows, campaign.measurements.joints)

    def __getitem__(self, count: int) -> Pool:
        """The first ones."""
        return Pool(self.rows[:count], self.joints[:count])

    def problem(self, name: str, readings: int = READINGS) -> DesignProblem:
        """State a choice, from the rows."""
        candidates = Candidates.from_rows(self.rows)
        return DesignProblem(candidates, self.criterion(name), readings, np.zeros((6, 6)))

    def criterion(self, name: str) -> DOptimality | AOptimality:
        """Return a criterion by its name."""
        if name == "D":
            return DOptimality(6)
        places = self.rows[:: max(1, len(self.rows) // 500)].reshape(-1, 6)
        return AOptimality(np.eye(6) if name == "relative A" else places.T @ places)

    def information(self, weights: FloatArray) -> FloatArray:
        """Return the information (6, 6) of weights, brought to a sum of 1."""
        w = np.maximum(weights, 0.0)
        M: FloatArray = READINGS * np.einsum(
            "i,imp,imq->pq", w / w.sum(), self.rows, self.rows, optimize=True
        )
        return M
