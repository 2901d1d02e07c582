"""Certificate of a method of several stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jointstiff.solver.convex.certificate import Certificate


@dataclass(frozen=True)
class StagesCertificate:
    """The greatest violations of the optimality conditions over the stages of a method, dimensionless.

    Attributes:
        primal: of a bound.
        dual: gradient of the wrong sign.
        complementarity: min(multiplier, slack).
        solved_by: what found the support of each stage.
    """

    primal: float
    dual: float
    complementarity: float
    solved_by: tuple[str, ...]

    @classmethod
    def of(cls, stages: Sequence[Certificate]) -> StagesCertificate:
        """Combine the certificates of the stages, at least one."""
        return cls(
            primal=max(stage.primal for stage in stages),
            dual=max(stage.dual for stage in stages),
            complementarity=max(stage.complementarity for stage in stages),
            solved_by=tuple(stage.solved_by for stage in stages),
        )
