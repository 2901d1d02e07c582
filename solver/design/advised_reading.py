"""One more reading that is advised, with what it would bring, in numbers and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Advice:
    """One more reading that would tell more of a joint."""

    joint: int  #: index of the joint
    joints: FloatArray  #: (n,) angles of the posture as the controller shows them [rad]
    observation: int | None  #: the observation that has this posture; None for a new one
    force: FloatArray  #: (3,) on the robot, axes of R0 [N]
    own_direction: bool  #: whether the force is the one that the whole set was loaded with
    torque: float  #: torque of that force about the joint [N·m]
    #: standard uncertainty of the compliance after the reading, in units of sigma [rad/(N·m)/m]
    deviation: float
    #: standard uncertainty of one coordinate of one reading [m]; None where it is unknown
    sigma: float | None
    #: of the standard uncertainties after and before; None where the readings so far do not determine the
    #: compliance
    uncertainty_ratio: float | None
    #: whether the estimate itself has the uncertainties of the partial pose, so that the same method will
    #: find what is promised; other weights, the decoupled method and priors have not
    same_method: bool

    @property
    def standard_uncertainty(self) -> float | None:
        """Standard uncertainty of the compliance after the reading [rad/(N·m)]."""
        return None if self.sigma is None else self.sigma * self.deviation

    def in_words(self, names: Sequence[str], labels: Sequence[str]) -> str:
        """Return the advice as a sentence."""
        if self.observation is not None:
            posture = f"in posture {labels[self.observation]}"
        else:
            angles = ", ".join(f"{angle:.0f}" for angle in np.degrees(self.joints))
            posture = f"in posture ({angles})°, if it is free of collisions,"
        return f"{posture} {self._load()}: {self._gain(names[self.joint])}"

    def _load(self) -> str:
        size = float(np.linalg.norm(self.force))
        if self.own_direction:
            return f"apply the load of {size:.4g} N as before"
        direction = ", ".join(f"{part / size + 0.0:.2f}" for part in self.force.tolist())
        return f"apply {size:.4g} N along ({direction})"

    def _gain(self, name: str) -> str:
        """Return what the reading gains: the uncertainty, its change, or at least the torque."""
        method = "" if self.same_method else "with method partial_pose "
        ratio = self.uncertainty_ratio
        change = "" if ratio is None else f", {ratio:.2g} times its present value"
        if self.standard_uncertainty is not None:
            return f"{method}u({name}) falls to {self.standard_uncertainty:.2g} rad/(N.m){change}"
        if ratio is not None:
            return f"{method}u({name}) falls to {ratio:.2g} times its present value"
        return f"a torque of {self.torque:.3g} N.m about the axis of {name}"
