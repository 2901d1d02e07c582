"""Certificate of a method of several stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jointstiff.solver.convex.certificate import Certificate


@dataclass(frozen=True)
class StagesCertificate:
    """The greatest violations of the optimality conditions over the stages of a method, dimensionless."""

    primal: float  #: of a bound
    dual: float  #: gradient of the wrong sign
    complementarity: float  #: min(multiplier, slack)
    solved_by: tuple[str, ...]  #: what found the support of each stage

    @classmethod
    def of(cls, stages: Sequence[Certificate]) -> StagesCertificate:
        """Combine the certificates of the stages, at least one."""
        return cls(
            primal=max(stage.primal for stage in stages),
            dual=max(stage.dual for stage in stages),
            complementarity=max(stage.complementarity for stage in stages),
            solved_by=tuple(stage.solved_by for stage in stages),
        )
