"""Identification of a campaign by a model of joints alone; each result is computed once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

from jointstiff.schemas.finding import Finding
from jointstiff.solver.evidence.alternatives import BetterAlternative, find_better_alternative
from jointstiff.solver.evidence.causes import Screening, screen_estimate
from jointstiff.solver.evidence.refuted import leave_out, list_refuted
from jointstiff.solver.evidence.scatter import find_scatter
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.identify import identify_with_fallback
from jointstiff.solver.fit.method import Loss, Settings
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot


class JointsAlone:
    """Identification of a campaign by a model in which only joints bend, computed when first needed.

    Attributes:
        robot: n joints.
        labels: labels of all observations, before any were left out.
        refuted: labels of single observations that the findings forbid to use, and that no fit uses.
        given: N observations without the refuted ones, with the scatter that was stated.
        stated: settings as the user gave them.
        noticed: findings of the integrity checks of the measurements.
    """

    def __init__(
        self, robot: Robot, measurements: Measurements, stated: Settings, noticed: Sequence[Finding] = ()
    ) -> None:
        """Keep the data of the identification; nothing is computed yet."""
        self.robot, self.stated = robot, stated
        self.noticed, self.labels = tuple(noticed), measurements.labels
        self.refuted = list_refuted(measurements, noticed)
        self.given, self._whole = leave_out(measurements, self.refuted), measurements
        self._by_loss: dict[Loss, JointsAlone] = {stated.loss: self}

    def with_loss(self, loss: Loss) -> JointsAlone:
        """Return the identification of the same measurements with another loss.

        This object itself is returned for its own loss; an identification is kept for each loss.
        """
        if loss not in self._by_loss:
            stated = replace(self.stated, loss=loss)
            self._by_loss[loss] = JointsAlone(self.robot, self._whole, stated, self.noticed)
        return self._by_loss[loss]

    @cached_property
    def _identified(self) -> tuple[Settings, Estimate, Measurements]:
        """Settings with which the fit succeeded, the estimate, and the measurements with their scatter.

        The scatter (errors that the targets of a posture share) is estimated from the residuals of a first
        fit; where it is significant, the joints are fitted again.
        """
        settings, estimate = identify_with_fallback(self.robot, self.given, self.stated)
        scatter = find_scatter(self.robot, self.given, estimate)
        if scatter == self.given.scatter:
            return settings, estimate, self.given
        measurements = replace(self.given, scatter=scatter)
        settings_with_scatter, estimate_with_scatter = identify_with_fallback(
            self.robot, measurements, self.stated
        )
        test = estimate_with_scatter.sigma_test
        if test is not None and test.result == "residuals_too_large":
            # Errors that do not explain the residuals are no explanation of a part of the residuals.
            return settings, estimate, self.given
        return settings_with_scatter, estimate_with_scatter, measurements

    @property
    def measurements(self) -> Measurements:
        """The N observations, with the scatter that their residuals show.

        Raises:
            JointstiffError: the identification fails.
        """
        return self._identified[2]

    @property
    def shows_scatter(self) -> bool:
        """True if the residuals show errors that the targets of a posture share, beyond those stated.

        Raises:
            JointstiffError: the identification fails.
        """
        return self.measurements.scatter != self.given.scatter

    @property
    def settings(self) -> Settings:
        """Settings with which the fit succeeded: without K_c if the fit with K_c failed.

        Raises:
            JointstiffError: the identification fails.
        """
        return self._identified[0]

    @property
    def estimate(self) -> Estimate:
        """Estimated compliances with uncertainties and certificates.

        Raises:
            JointstiffError: the identification fails, for one of the reasons listed at `identify`.
        """
        return self._identified[1]

    @cached_property
    def screening(self) -> Screening:
        """Tests for causes of the deflections that the joints do not explain.

        Raises:
            JointstiffError: the identification fails.
        """
        return screen_estimate(self.robot, self.given, self.estimate, self.shows_scatter)

    @cached_property
    def _alternative(self) -> BetterAlternative | None:
        """Mistake in the data whose correction explains the readings far better; None if no mistake does."""
        return find_better_alternative(self.robot, self.given)

    def find_gross_mistake(self, estimate: Estimate) -> BetterAlternative | None:
        """Return the mistake whose correction explains the readings far better; None if no mistake does.

        If the estimate's residuals are within the stated noise, no mistake is sought.
        """
        explained = residuals_within_noise(estimate) and not self.shows_scatter
        return None if explained else self._alternative

    @property
    def are_sound(self) -> bool:
        """True if no gross mistake was found in the data: only then are tests of smaller effects valid."""
        if any(finding.weight == "do_not_use" for finding in self.noticed):
            return False
        return self.find_gross_mistake(self.estimate) is None


def residuals_within_noise(estimate: Estimate) -> bool:
    """Return whether sigma was stated, and the residuals are not larger than sigma predicts."""
    test = estimate.sigma_test
    return test is not None and test.result != "residuals_too_large"
