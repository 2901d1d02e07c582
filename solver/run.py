"""The story of a run: from readings and options to the result that people read.

1. The request is checked against the robot, or refused; named causes are fitted together with the joints.
2. The joints are identified alone, once, and screened for what they leave unexplained.
3. Models that the screening asks for compete with them on held-out postures.
4. Postures that are left out show the model error, which widens intervals where joints alone do not fit.
5. The model is assessed, and reported with what to do about it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy.typing as npt

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import RunResult
from jointstiff.solver.choice.competition import Competition, Winner, find_obstacle_to_elastic_links
from jointstiff.solver.design.plan import advise_next_readings
from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.evidence.fitted_causes import fit_causes
from jointstiff.solver.evidence.joints import JointsAlone
from jointstiff.solver.evidence.refuted import list_refuted
from jointstiff.solver.evidence.resampling import Draws
from jointstiff.solver.fit.method import Loss, Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.own_weight.run import run_by_weight
from jointstiff.solver.result import (
    RunOutcome,
    build_run_result,
    describe_choice_by_comparison,
    describe_choice_of_joints,
    report_elastic_model,
    report_joints_alone,
)

Arrays: TypeAlias = Mapping[str, npt.NDArray[Any]]
"""Arrays that one step of a long run computes, by the arrays' names."""


def run(
    robot: Robot, measurements: Measurements, options: RunOptions, noticed: Sequence[Finding] = ()
) -> RunResult:
    """Identify the joint stiffnesses of a robot from a campaign; return them with intervals and a verdict.

    Args:
        robot: robot with n joints.
        measurements: readings of N observations.
        options: options of the identification, such as method, loss and elasticity.
        noticed: findings of the integrity checks of these measurements (`jointstiff.solver.integrity`).

    Raises:
        RequestError: the readings or the robot cannot support the options.
        JointstiffError: the identification fails; the error says why.
    """
    identification = Identification(robot, measurements, options, noticed)
    long = identification.long
    return identification.conclude([] if long is None else [long.compute(span) for span in long.steps()])


class Identification:
    """Run of an identification, checked when created, then computed in steps and concluded.

    Attributes:
        long: time-consuming part of the run, whose steps may be computed by any process: resampling, or a
            competition of models; None for a run without such a part.
    """

    def __init__(
        self, robot: Robot, measurements: Measurements, options: RunOptions, noticed: Sequence[Finding] = ()
    ) -> None:
        """Check the request; if the model is to be chosen automatically, also identify the joints.

        Args:
            robot: robot with n joints.
            measurements: readings of N observations.
            options: options of the identification, such as method, loss and elasticity.
            noticed: findings of the integrity checks of these measurements.

        Raises:
            RequestError: the readings or the robot cannot support the options.
        """
        self._robot, self._measurements, self._options = robot, measurements, options
        self._noticed = tuple(noticed)
        self.long: Draws | Competition | None = None
        if options.weight is None:  # a run by the robot's own weight has no long part
            causes = [cause.name_and_first_label for cause in options.causes]
            refuted = list_refuted(measurements, self._noticed)
            self._measurements = fit_causes(Rows(robot, measurements.require_loads()), causes, refuted)
            self._settings = Settings.from_options(options, robot)
            self.long = self._competition
            if self.long is None and options.resampling is not None:
                self.long = Draws(self._joints, options.resampling)

    @cached_property
    def _joints(self) -> JointsAlone:
        """Model in which only joints bend, fitted to the readings."""
        return JointsAlone(Rows(self._robot, self._measurements), self._settings, self._noticed)

    @cached_property
    def _excluded(self) -> str | None:
        """Name of the option that rules out elastic links in an automatic choice; None if no option does."""
        if self._options.elasticity != "automatic":
            return None
        return find_obstacle_to_elastic_links(self._options, self._settings, self._robot, self._measurements)

    @cached_property
    def _competition(self) -> Competition | None:
        """Comparison of elastic models with joints alone; None if options or readings exclude links."""
        options = self._options
        if options.elasticity == "joints":
            return None
        if options.elasticity == "automatic" and (
            self._excluded is not None or not self._links_or_base_may_bend()
        ):
            return None
        return Competition(self._joints, options)

    def _links_or_base_may_bend(self) -> bool:
        """Return whether links or base seem to bend, and the readings contain no gross mistake.

        A gross mistake in the readings leaves residuals that look like those of elastic links.
        """
        try:
            screening = self._joints.screening
            bends = screening.links_need_validation or screening.base_needs_validation
        except JointstiffError:  # the run fails when it is carried out, and says why
            return False
        return bends and self._joints.are_sound

    def conclude(self, parts: Sequence[Arrays]) -> RunResult:
        """Compute the result of the run from the arrays of its long part.

        Args:
            parts: arrays that the steps of the long part computed, in the order of the steps; empty for a
                run without a long part.

        Raises:
            JointstiffError: the identification fails; the error says why.
        """
        if self._options.weight is not None:
            return run_by_weight(self._robot, self._measurements, self._options, self._noticed)
        if isinstance(self.long, Competition):
            outcome = self._report_winner(self.long, self.long.choose_winner(parts))
        else:
            screening = replace(self._joints.screening, comparable=self._excluded is None)
            choice = describe_choice_of_joints(self._options, screening, self._excluded)
            outcome = report_joints_alone(self._joints, screening, choice)
        # Further readings are advised only if the readings contain no mistake and only joints bend: else the
        # gain of another reading is unknown.
        usable = outcome.assessment.verdict != "do_not_use" and outcome.links is None
        measurements = self._joints.measurements
        advice = advise_next_readings(self._robot, measurements, outcome.estimate) if usable else ()
        resampling = self.long.statistics(parts) if isinstance(self.long, Draws) else None
        return build_run_result(outcome, measurements, advice, resampling)

    def _report_winner(self, competition: Competition, winner: Winner) -> RunOutcome:
        """Build the outcome of the best model: an elastic model, or joints alone with the better loss."""
        screening = replace(competition.screening, gain=winner.selection.gain)
        if winner.elastic is not None:
            return report_elastic_model(self._joints, competition, winner, winner.elastic, screening)
        loss: Loss = "huber" if winner.held_out.loss == "huber" else "squared"
        return report_joints_alone(
            self._joints.with_loss(loss), screening, describe_choice_by_comparison(winner, screening)
        )
