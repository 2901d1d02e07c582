"""Identification of a campaign by a model of joints alone; each result is computed once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

from jointstiff.schemas.finding import Finding
from jointstiff.solver.errors import NotObservableError
from jointstiff.solver.evidence.causes import Screening, screen_estimate
from jointstiff.solver.evidence.refuted import leave_out, list_refuted
from jointstiff.solver.evidence.scatter import FoundScatter, Posterior, find_scatter
from jointstiff.solver.evidence.structure import Apart, take_apart
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.fit import fit
from jointstiff.solver.fit.identify import JointsFit, describe
from jointstiff.solver.fit.method import Loss, Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.models import JOINTS


class IdentifiedJoints(NamedTuple):
    """Result of fitting joints alone."""

    settings: Settings  #: settings with which the fit succeeded: without K_c if the fit with K_c failed
    estimate: Estimate
    rows: Rows  #: N observations, with the scatter that the fit accounts for
    shows_scatter: bool  #: whether the residuals show a scatter beyond the stated one
    tested: JointsFit  #: fit for tests, with the scatter that is stated or shown, but none that is assumed
    #: posterior of the scatter of `rows`; None if the scatter is as stated
    posterior: Posterior | None = None


class JointsAlone:
    """Identification of a campaign by a model in which only joints bend, computed when first needed.

    Attributes:
        robot: n joints.
        labels: labels of all observations, before any were left out.
        refuted: labels of single observations that the findings forbid to use, and that no fit uses.
        stated: settings as the user gave them.
        noticed: findings of the integrity checks of the measurements.
    """

    def __init__(self, rows: Rows, stated: Settings, noticed: Sequence[Finding] = ()) -> None:
        """Keep the data of the identification; nothing is computed yet."""
        measurements = rows.measurements
        self.robot, self.stated = rows.robot, stated
        self.noticed, self.labels = tuple(noticed), measurements.labels
        self.refuted = list_refuted(measurements, noticed)
        self._whole = rows  # with the refuted observations
        self._read = rows.of(leave_out(measurements, self.refuted)) if self.refuted else rows
        self._by_loss: dict[Loss, JointsAlone] = {stated.loss: self}

    def with_loss(self, loss: Loss) -> JointsAlone:
        """Return the identification of the same measurements with another loss.

        This object itself is returned for its own loss; an identification is kept for each loss.
        """
        if loss not in self._by_loss:
            stated = replace(self.stated, loss=loss)
            self._by_loss[loss] = JointsAlone(self._whole, stated, self.noticed)
        return self._by_loss[loss]

    @cached_property
    def apart(self) -> Apart | None:
        """Compliance of gearboxes and of the structure behind them, separated by secondary encoders.

        An encoder sees what its gearbox yields; targets see also what bends behind it. None without encoders,
        or if the targets show no joint.

        Raises:
            JointstiffError: the identification fails.
        """
        if self._read.measurements.encoders is None:
            return None
        by_targets = self._without_encoders()
        try:
            estimate_by_targets = describe(fit(by_targets, JOINTS, self.stated))
        except NotObservableError:  # only the encoders show joints
            return None
        return take_apart(self._read, estimate_by_targets, self.stated.confidence)

    @cached_property
    def given(self) -> Rows:
        """Rows of N observations without the refuted ones, with the scatter that was stated.

        If something behind the encoders bends, encoders do not see the whole compliance of a joint, so that
        their readings are left out.
        """
        bends_behind_encoders = self.apart is not None and self.apart.shows_structure
        return self._without_encoders() if bends_behind_encoders else self._read

    @property
    def measured(self) -> Measurements:
        """The N observations as they were read, with the encoders."""
        return self._read.measurements

    def _without_encoders(self) -> Rows:
        """Return the observations with the readings of the targets alone."""
        return self._read.of(replace(self._read.measurements, encoders=None))

    @cached_property
    def identified(self) -> IdentifiedJoints:
        """Fit of the joints.

        The scatter (errors that the targets of a posture share) is estimated from prior and residuals of a
        first fit; then the joints are fitted again.

        Raises:
            JointstiffError: the identification fails, for one of the reasons listed at `identify`.
        """
        first = fit(self.given, JOINTS, self.stated)
        found = find_scatter(self.given, first)
        if found.scatter == self.given.measurements.scatter:  # nothing is assumed or shown
            return self._describe_without_scatter(first)
        rows = self.given.with_scatter(found.scatter)
        last = fit(rows, JOINTS, self.stated)
        estimate = describe(last)
        # If the residuals are too large even with the scatter, the scatter is no explanation of them.
        if _exceed_stated_noise(estimate):
            return self._describe_without_scatter(first)
        if not found.scatter.is_assumed:
            return IdentifiedJoints(last.settings, estimate, rows, found.is_shown, last, found.posterior)
        tested = self._fit_without_assumed_scatter(first, found)
        # Errors that are only assumed must make a stated sigma seem neither too large nor right.
        if tested.scale.given:
            estimate = estimate.with_residuals_of(tested.scale)
        return IdentifiedJoints(last.settings, estimate, rows, found.is_shown, tested, found.posterior)

    def _describe_without_scatter(self, first: JointsFit) -> IdentifiedJoints:
        """Return the result of the first fit, which accounts for no scatter but the stated one."""
        return IdentifiedJoints(
            first.settings, describe(first), self.given, shows_scatter=False, tested=first
        )

    def _fit_without_assumed_scatter(self, first: JointsFit, found: FoundScatter) -> JointsFit:
        """Return the fit for tests: with the stated scatter, but none that is only assumed.

        The first fit has the stated scatter, too, but the stated noise of the encoders; the joints are fitted
        again only if another noise of the encoders is more likely.

        Args:
            first: fit with scatter and noise of the encoders as stated.
            found: scatter that was found from prior and residuals.
        """
        scatter_of_first = self.given.measurements.scatter
        if found.as_stated == scatter_of_first:
            return first
        return fit(self.given.with_scatter(found.as_stated), JOINTS, self.stated)

    @property
    def rows(self) -> Rows:
        """Rows of the N observations, with the scatter that the fit accounts for."""
        return self.identified.rows

    @property
    def tested(self) -> Rows:
        """Rows of the N observations for tests: with the scatter that is stated or shown, none assumed."""
        return self.given if self.measurements.scatter.is_assumed else self.rows

    @property
    def measurements(self) -> Measurements:
        """The N observations, with the scatter that the fit accounts for."""
        return self.identified.rows.measurements

    @property
    def shows_scatter(self) -> bool:
        """True if the residuals show errors that the targets of a posture share, beyond those stated."""
        return self.identified.shows_scatter

    @property
    def settings(self) -> Settings:
        """Settings with which the fit succeeded: without K_c if the fit with K_c failed."""
        return self.identified.settings

    @property
    def estimate(self) -> Estimate:
        """Estimated compliances with uncertainties and certificates."""
        return self.identified.estimate

    @cached_property
    def screening(self) -> Screening:
        """Tests for causes of the deflections that the joints do not explain.

        Raises:
            JointstiffError: the identification fails.
        """
        return screen_estimate(self.given, self.estimate, self.shows_scatter)

    @property
    def has_sound_data(self) -> bool:
        """True if no gross mistake was found in the data: only then are tests of smaller effects valid."""
        return not any(finding.weight == "do_not_use" for finding in self.noticed)


def _exceed_stated_noise(estimate: Estimate) -> bool:
    """Return whether sigma was stated, and the residuals are larger than sigma predicts."""
    test = estimate.sigma_test  # None if no sigma was stated
    return test is not None and test.result == "residuals_too_large"


def residuals_within_noise(estimate: Estimate) -> bool:
    """Return whether sigma was stated, and the residuals are not larger than sigma predicts."""
    test = estimate.sigma_test  # None if no sigma was stated
    return test is not None and test.result != "residuals_too_large"
