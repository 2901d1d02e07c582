"""The joints of a campaign identified alone: estimate, screening and gross mistake, each made once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

from jointstiff.schemas.finding import Finding
from jointstiff.solver.estimation.causes import (
    BetterAlternative,
    Screening,
    better_alternative,
    screen_estimate,
)
from jointstiff.solver.estimation.estimate import Estimate
from jointstiff.solver.estimation.identify import identify_balanced
from jointstiff.solver.estimation.method import Loss, Settings
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot


class JointsAlone:
    """Joints of a campaign by one method and loss; each part is made when it is first needed.

    Attributes:
        robot: n joints.
        measurements: N observations.
        stated: settings as they were stated.
        noticed: findings of the integrity checks of the measurements.
    """

    def __init__(
        self, robot: Robot, measurements: Measurements, stated: Settings, noticed: Sequence[Finding] = ()
    ) -> None:
        """Keep what the joints are identified from."""
        self.robot, self.measurements, self.stated = robot, measurements, stated
        self.noticed = tuple(noticed)
        self._by_loss: dict[Loss, JointsAlone] = {stated.loss: self}

    def with_loss(self, loss: Loss) -> JointsAlone:
        """Return the joints by another loss; the same object by its own."""
        if loss not in self._by_loss:
            stated = replace(self.stated, loss=loss)
            self._by_loss[loss] = JointsAlone(self.robot, self.measurements, stated, self.noticed)
        return self._by_loss[loss]

    @cached_property
    def _identified(self) -> tuple[Settings, Estimate]:
        return identify_balanced(self.robot, self.measurements, self.stated)

    @property
    def settings(self) -> Settings:
        """Settings that were used: as stated, or without K_c; raises as `estimate`."""
        return self._identified[0]

    @property
    def estimate(self) -> Estimate:
        """Compliances with their evidence.

        Raises:
            JointstiffError: as `jointstiff.solver.estimation.identify.identify`.
        """
        return self._identified[1]

    @cached_property
    def screening(self) -> Screening:
        """Tests of what the joints leave unexplained; raises as `estimate`."""
        return screen_estimate(self.robot, self.measurements, self.estimate)

    @cached_property
    def _alternative(self) -> BetterAlternative | None:
        return better_alternative(self.robot, self.measurements)

    def gross_mistake(self, estimate: Estimate) -> BetterAlternative | None:
        """Return the mistake that would explain the readings far better than an estimate of these readings.

        Residuals within a stated noise leave nothing for a mistake to explain.
        """
        return None if within_noise(estimate) else self._alternative

    @property
    def are_sound(self) -> bool:
        """Tell whether no gross mistake shows, behind which tests of smaller effects say nothing."""
        if any(finding.weight == "do_not_use" for finding in self.noticed):
            return False
        return self.gross_mistake(self.estimate) is None


def within_noise(estimate: Estimate) -> bool:
    """Tell whether the residuals leave nothing for another explanation."""
    test = estimate.sigma_test
    return test is not None and test.result != "residuals_too_large"
