"""The field's observability indices, of a regressor whose scale needs neither unit nor frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.observability.identifiability import Observability, Spectrum


@dataclass(frozen=True)
class ObservabilityIndices:
    """Observability indices of a set of postures and loads; larger is better.

    Of the singular values ``s_1 ≥ … ≥ s_p`` of the regressor, each of its p columns divided by the norm
    that it would have had if, in every observation, the force had pulled across the joint's lever
    and the moment had turned about its axis. As ``Σ s² ≤ p``, no index exceeds 1.
    """

    o1: float  #: ``(s_1 ⋯ s_p)^(1/p)``, Borm & Menq 1991
    o2: float  #: ``s_p / s_1``, Driels & Pathre 1990
    o3: float  #: ``s_p``, Nahvi, Hollerbach & Hayward 1994
    o4: float  #: ``s_p² / s_1``, Nahvi & Hollerbach 1996
    o5: float  #: ``1 / (1/s_1 + … + 1/s_p)``, Sun & Hollerbach 2008

    @classmethod
    def of(cls, singular_values: FloatArray) -> ObservabilityIndices:
        """The indices of positive singular values (p,), largest first."""
        s = singular_values
        return cls(
            o1=float(np.exp(np.log(s).mean())),
            o2=float(s[-1] / s[0]),
            o3=float(s[-1]),
            o4=float(s[-1] ** 2 / s[0]),
            o5=float(1.0 / np.sum(1.0 / s)),
        )


def observability_indices(regressor: FloatArray, observability: Observability) -> ObservabilityIndices | None:
    """IndexArray over the joints that the readings see.

    Borm & Menq divide by the root of the number of readings; here the norms that divide the columns grow
    with it, so that readings taken twice change nothing.

    Args:
        regressor: (m, n) of all readings, weighted by their covariance, in any unit.
        observability: of the same readings.

    Returns:
        The indices; None where the rank is not full.
    """
    visible = ~observability.null
    spectrum = Spectrum(regressor[:, visible])
    if spectrum.rank < np.count_nonzero(visible):
        return None
    columns = regressor[:, visible] / spectrum.scale * observability.excitation[visible]
    singular_values: FloatArray = np.linalg.svd(columns, compute_uv=False).astype(np.float64, copy=False)
    return ObservabilityIndices.of(singular_values)
