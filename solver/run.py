"""The story of a run: from readings and options to the result that people read.

1. The request is checked against the robot, or refused; named causes are fitted together with the joints.
2. The joints are identified alone, once, and screened for what they leave unexplained.
3. Models that the screening asks for compete with them on held-out postures.
4. Evidence for the chosen model is gathered: postures that are left out, budget, doubt about the load point.
5. The model is judged, and reported with what to do about it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy.typing as npt

from jointstiff.schemas.finding import Finding
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Advice, RunResult
from jointstiff.solver.choice.competition import Competition, find_obstacle_to_elastic_links
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
from jointstiff.solver.outcome.found import (
    Found,
    describe_choice_by_comparison,
    describe_choice_of_joints,
    find_elastic,
    find_joints,
)
from jointstiff.solver.outcome.result import describe_found
from jointstiff.solver.outcome.rules import assess
from jointstiff.solver.own_weight.run import identify_by_weight

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
    arrays_of_steps = list[Arrays]()
    if identification.long is not None:
        for span in identification.long.steps():
            arrays_of_steps.append(identification.long.compute(span))
    return identification.conclude(arrays_of_steps)


class Identification:
    """Run of an identification, checked when created, then computed in steps and concluded.

    Attributes:
        long: time-consuming part of the run, whose steps may be computed by any process: resampling, or a
            competition of models; None for a run without such a part.
    """

    def __init__(
        self, robot: Robot, measurements: Measurements, options: RunOptions, noticed: Sequence[Finding] = ()
    ) -> None:
        """Check the request, and decide whether the run has a long part.

        If the model is to be chosen automatically, the joints are identified to decide this. Errors of the
        campaign that the user names as causes are fitted first, and subtracted from the readings. A run by
        the robot's own weight has no long part, and is checked when it is computed.

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
        self._obstacle: str | None = None  # option that rules out elastic links in an automatic choice
        self.long: Draws | Competition | None = None
        is_by_own_weight = options.weight is not None
        if is_by_own_weight:
            return
        corrected = self._correct_for_named_causes()
        settings = Settings.from_options(options, robot)
        self._joints = JointsAlone(corrected, settings, self._noticed)
        if options.elasticity == "automatic":
            self._obstacle = find_obstacle_to_elastic_links(options, settings, robot, corrected.measurements)
        self.long = self._choose_long_part()

    def _correct_for_named_causes(self) -> Rows:
        """Return the rows of the readings, corrected for the errors that the user names as causes.

        Readings that contradict a stated number are left out of the fit of the causes.

        Raises:
            RequestError: an observation has no load.
        """
        named_causes = [cause.name_and_first_label for cause in self._options.causes]
        refuted = list_refuted(self._measurements, self._noticed)
        as_measured = Rows(self._robot, self._measurements.require_loads())
        return as_measured.of(fit_causes(as_measured, named_causes, refuted))

    def _choose_long_part(self) -> Draws | Competition | None:
        """Return the part of the run that takes long: a competition of models or else resampling, if any."""
        if self._compares_models():
            return Competition(self._joints, self._options)
        if self._options.resampling is not None:
            return Draws(self._joints, self._options.resampling)
        return None

    def _compares_models(self) -> bool:
        """Return whether elastic models compete: if requested, or if links or base seem to bend.

        They do not compete if an option rules them out, or if the readings are unsound: a gross mistake
        leaves residuals that look like those of elastic links. If the identification of the joints fails, the
        answer is no: `conclude` then fails with the same error, which says why.
        """
        requested = self._options.elasticity
        if requested != "automatic":
            return requested != "joints"
        if self._obstacle is not None:
            return False
        try:
            screening = self._joints.screening
            seems_to_bend = screening.links_need_validation or screening.base_needs_validation
        except JointstiffError:
            return False
        return seems_to_bend and self._joints.has_sound_data

    def conclude(self, parts: Sequence[Arrays]) -> RunResult:
        """Compute the result of the run from the arrays of its long part.

        The result has advice on further readings only if only joints bend and the readings contain no
        mistake: else the gain of another reading is unknown.

        Args:
            parts: arrays that the steps of the long part computed, in the order of the steps; empty for a
                run without a long part.

        Raises:
            JointstiffError: the identification fails; the error says why.
        """
        if self._options.weight is not None:
            return identify_by_weight(self._robot, self._measurements, self._options, self._noticed)
        joints, found = self._joints, self._find_model(parts)
        assessment = assess(joints, found.estimate, found.prediction, found.screening, found.doubt)
        only_joints_bend = found.links is None
        advice: tuple[Advice, ...] = ()
        if only_joints_bend and assessment.verdict != "do_not_use":
            advice = advise_next_readings(self._robot, joints.measurements, found.estimate)
        resampling = self.long.statistics(parts) if isinstance(self.long, Draws) else None
        return describe_found(found, assessment, joints.noticed, advice, resampling)

    def _find_model(self, parts: Sequence[Arrays]) -> Found:
        """Return the model of the run: the winner if models compete, or else joints alone.

        Args:
            parts: arrays of the steps of the competition; not used without one.
        """
        if isinstance(self.long, Competition):
            return self._find_best(self.long, parts)
        return self._find_joints()

    def _find_joints(self) -> Found:
        """Return the model in which only joints bend, of a run that compares no models.

        The screening are tests of what this model leaves unexplained; the choice is a message on why only
        joints are assumed to bend.
        """
        models_are_comparable = self._obstacle is None
        screening = replace(self._joints.screening, comparable=models_are_comparable)
        choice = describe_choice_of_joints(self._options, screening, self._obstacle)
        return find_joints(self._joints, screening, choice)

    def _find_best(self, competition: Competition, parts: Sequence[Arrays]) -> Found:
        """Return the model that predicts held-out postures best.

        The winner is a model with elastic links or base, or joints alone with one of the losses.
        """
        winner = competition.choose_winner(parts)
        screening = replace(competition.screening, gain=winner.selection.gain)
        if winner.elastic is not None:
            return find_elastic(self._joints, competition, winner, winner.elastic, screening)
        choice = describe_choice_by_comparison(winner, screening)
        loss: Loss = "huber" if winner.held_out.loss == "huber" else "squared"
        joints = self._joints.with_loss(loss)
        return find_joints(joints, screening, choice)
