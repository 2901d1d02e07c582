"""Orders of two ways on arms whose links bend, although the model has none: how often an order is wrong.

Half of the campaigns pull as hard as the process, half 4 times as hard. The truth is the exact balance of
joints and links as beams, which shares no code with the model.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff.schemas.run import Campaign
from jointstiff.service.conversion.prepared import prepare_robot, prepare_set
from jointstiff.simulator import default_arm
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_campaign, elastic_deflections
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.models import JointModel, ModelError, estimate_error_by_leaving_postures_out
from jointstiff.solver.process.deflection import PathDeflection
from jointstiff.solver.process.pace import Pace
from jointstiff.solver.process.path import ProcessPath
from jointstiff.solver.process.turning import TurnTask, choose_turns
from tests.support.catalogue_arms import build_nominal_robots, spring_arm
from tests.support.process_paths import SHAPES, process_path, reach_centre

__all__ = ["Pair", "compare_ways", "run"]

CAMPAIGNS = 48
ARMS = ("FANUC R-2000iC/210F", "KUKA KR 210 R2700 extra", "ABB IRB 6640-185/2.8", "Yaskawa GP180")
FORCES = (360.0, 1440.0)
"""Pulls of campaigns [N]; the force of the process has 356 N."""
PATHS = 6
POINTS = 12
TURNS = 18
FEED = 0.05
"""Feed along the paths [m/s]."""
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Pair:
    """Difference of two ways as foretold and as it is."""

    foretold: float  # [m]
    true: float  # [m]
    half: float  # half-width of the interval with the model error [m]
    half_of_readings: float  # half-width of the interval by the readings alone [m]

    def is_ordered(self, half: float) -> bool:
        """Return whether an interval of a half-width excludes zero."""
        return abs(self.foretold) > half

    @property
    def is_wrong(self) -> bool:
        """Return whether the truth has the other sign."""
        return self.foretold * self.true < 0.0


def _prepare(document: dict[str, Any]) -> tuple[Robot, Measurements]:
    """Return robot and readings of a campaign document, without assumed errors of the load."""
    campaign = Campaign.model_validate_json(json.dumps(document))
    prepared = prepare_robot(campaign.robot)
    measurements = prepare_set(campaign.measurement_set, prepared, "arm").measurements
    return prepared.robot, replace(measurements, common_uncertainty=measurements.common_uncertainty.stated)


def run(*, quick: bool, part: Part) -> list[Section]:
    """Compare ways after campaigns that pull as hard as the process, and harder."""
    rows, figures = [], []
    for force in FORCES:
        pairs = [
            pair for number in part.of(4 if quick else CAMPAIGNS) for pair in compare_ways(number, force)
        ]
        counts = []
        for halves in ([each.half for each in pairs], [each.half_of_readings for each in pairs]):
            ordered = [each for each, half in zip(pairs, halves, strict=True) if each.is_ordered(half)]
            wrong = sum(each.is_wrong for each in ordered)
            covered = sum(
                abs(each.foretold - each.true) <= half for each, half in zip(pairs, halves, strict=True)
            )
            counts.append((len(ordered) / len(pairs), wrong / max(1, len(ordered)), covered / len(pairs)))
        rows.append(
            (
                f"{force:.0f} N",
                str(len(pairs)),
                *(f"{100 * each:.1f} %" for each in counts[0]),
                *(f"{100 * each:.1f} %" for each in counts[1]),
            )
        )
        figures.append(
            Figure(f"{force:.0f} N: stated orders that are right", 1.0 - counts[0][1], "at least", 0.975)
        )
    columns = (
        "campaign's pull",
        "pairs of ways",
        "ordered",
        "wrong of these",
        "covered",
        "by readings: ordered",
        "wrong",
        "covered",
    )
    return [Section("Orders of two ways, links left out of the model", columns, tuple(rows), tuple(figures))]


def compare_ways(number: int, force: float) -> Iterator[Pair]:
    """Yield all pairs of turned, fixed, unturned and moved ways of some paths on one drawn arm.

    Args:
        number: number of the campaign, from which everything is drawn.
        force: pull of the campaign [N].
    """
    draw = np.random.default_rng([71, number])
    arm = default_arm()
    if number % 3:
        known = {each.name: each.robot for each in build_nominal_robots()}
        arm = spring_arm(known[ARMS[number % len(ARMS)]])
    arm = replace(arm, stiffnesses=arm.stiffnesses * 2.0 ** draw.uniform(-1.0, 1.0, 6))
    bending = 10.0 ** draw.uniform(6.3, 7.7)
    elastic = beam_arm(arm, bending=bending, torsion=0.7 * bending, axial=300 * bending, shear=100 * bending)
    campaign = elastic_campaign(
        elastic, configurations=int(draw.integers(20, 61)), force=force, sigma=1e-5, seed=number
    )
    robot, measurements = _prepare(campaign)
    settings = Settings("complete_pose", "covariance", Bounds.positive(6))
    rows = Rows(robot, measurements)
    estimate = identify(rows, settings)
    model = JointModel.from_estimate(robot, estimate, settings.constraints)
    error = estimate_error_by_leaving_postures_out(rows, settings, estimate, model)
    for _ in range(PATHS):
        place = reach_centre(robot, draw.uniform(0.5, 0.75), draw.uniform(0.1, 0.4), draw.uniform(-0.3, 0.3))
        path = process_path(
            str(draw.choice(list(SHAPES))),
            place,
            yaw=draw.uniform(0.0, 2.0 * np.pi),
            count=POINTS,
            angle=float(draw.choice([np.pi / 4, np.pi / 2])),
        )
        ways = [
            _evaluate(robot, model, error, elastic, each, joints)
            for each, joints in _list_ways(model, path, draw)
        ]
        for (first, true_first), (second, true_second) in combinations(ways, 2):
            if first.size == second.size:
                continue  # the choice is a fixed turn
            difference = first.compare(second, CONFIDENCE).difference
            halves = [
                float("inf") if each is None else 0.5 * (each[1] - each[0])
                for each in (difference.with_model_error, difference.readings)
            ]
            yield Pair(difference.value, true_first - true_second, *halves)


def _list_ways(
    model: JointModel, path: ProcessPath, draw: np.random.Generator
) -> Iterator[tuple[ProcessPath, FloatArray]]:
    """Yield ways of one path: paths with the postures (m, n) along them."""
    inverse = InverseKinematics(model.robot)
    moves = [(np.zeros(3), 0.0)]
    moves += [
        (draw.uniform(-0.4, 0.4, 3) * [1.0, 1.0, 0.5], draw.uniform(0.0, 2.0 * np.pi)) for _ in range(3)
    ]
    for i, (shift, angle) in enumerate(moves):
        moved = path.move(shift, angle)
        try:
            pace = Pace(np.full(len(moved), FEED), model.robot.speeds)
            choice = choose_turns(model, inverse, moved, TurnTask.free(TURNS, 0.04, pace))
        except RequestError:
            continue  # the arm does not follow the path there
        yield moved, choice.joints
        if i == 0:
            yield from ((moved, each) for each in (choice.best_fixed, choice.unturned) if each is not None)


def _evaluate(
    robot: Robot,
    model: JointModel,
    error: ModelError,
    elastic: ElasticArm,
    path: ProcessPath,
    joints: FloatArray,
) -> tuple[PathDeflection, float]:
    """Return the deflection of a way as foretold, and its true root mean square [m]."""
    foretold = PathDeflection.predict(model, error, path.cases(np.arange(len(path)), joints))
    angles = robot.joint_map.model_angles(joints)
    unloaded, loaded = elastic_deflections(elastic, angles, path.force, path.load_point, path.place[:1])
    lengths = np.linalg.norm((loaded - unloaded)[:, 0], axis=1)
    return foretold, float(np.sqrt(np.mean(np.square(lengths))))
