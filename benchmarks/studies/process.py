"""Turned and placed paths: what is left of the deflection at turns and places by chance, and the time.

Arms are those of the catalogue for heavy loads, with stiffnesses by the prior of their payload and reach,
each drawn within a factor of two. Paths are a pocket, a blade and a trim at random places.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median
from time import process_time

import numpy as np

from benchmarks.report import Figure, Section
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.problem import Bounds, Constraints
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import measure_reach
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.process.path import ProcessPath
from jointstiff.solver.process.placing import PlaceBox, coarsen, evaluate_places, search_around
from jointstiff.solver.process.prior import build_prior_model
from jointstiff.solver.process.sequence import Motion
from jointstiff.solver.process.turning import TurnTask, choose_turns
from tests.support.catalogue_arms import build_nominal_robots
from tests.support.process_paths import SHAPES, process_path, reach_centre

__all__ = ["run"]

ARMS = (
    "FANUC R-2000iC/210F",
    "KUKA KR 210 R2700 extra",
    "ABB IRB 6640-185/2.8",
    "ABB IRB 6700-200/2.60",
    "Yaskawa GP180",
)
PATHS = 45
POINTS = 40
TASK = TurnTask.free(36, 0.04, Motion(np.radians(30.0), 0.05))
REQUIRED = {45: (0.80, 0.68), 90: (0.75, 0.60)}
"""Angle between spindle and last axis [°] → required medians: turned, and placed and turned."""
SECONDS = 1.0
SECONDS_PLACED = 60.0
GRID = (3, 4, 2)
PLACES = 8 * 3 * 4 * 2


@dataclass(frozen=True)
class Outcome:
    """Gains of one path, relative to the median of fixed turns in its place."""

    turned: float
    best_fixed: float
    placed: float
    seconds: float  # of the processor, to turn
    seconds_placed: float  # to search places


def run(*, quick: bool) -> list[Section]:
    """Turn and place paths with the spindle at 45° and at 90° to the last axis."""
    rows, figures = [], []
    for angle, (turned, placed) in REQUIRED.items():
        numbers = range(2 if quick else PATHS)
        outcomes = [_evaluate(number, angle) for number in numbers]
        worse = sum(each.turned > each.best_fixed * (1.0 + 1e-12) for each in outcomes)
        medians = [median(each.turned for each in outcomes), median(each.placed for each in outcomes)]
        rows.append(
            (
                f"{angle}°",
                str(len(outcomes)),
                f"{median(each.best_fixed for each in outcomes):.2f}",
                f"{medians[0]:.3f}",
                f"{np.mean([each.turned for each in outcomes]):.3f}",
                f"{medians[1]:.3f}",
                f"{np.mean([each.placed for each in outcomes]):.3f}",
                f"{max(each.seconds for each in outcomes):.2f}",
                f"{max(each.seconds_placed for each in outcomes):.0f}",
            )
        )
        figures += [
            Figure(
                f"{angle}°: deflection of turned paths / median fixed turn", medians[0], "at most", turned
            ),
            Figure(f"{angle}°: placed and turned / median fixed turn", medians[1], "at most", placed),
            Figure.none(f"{angle}°: paths whose best fixed turn is better", worse),
            Figure(
                f"{angle}°: processor for {POINTS} points, 36 turns, 8 branches",
                max(each.seconds for each in outcomes),
                "at most",
                SECONDS,
                "s",
            ),
            Figure(
                f"{angle}°: processor to place, {PLACES} places and the search around the best",
                max(each.seconds_placed for each in outcomes),
                "at most",
                SECONDS_PLACED,
                "s",
            ),
        ]
    columns = ("spindle", "paths", "best fixed", "turned", "mean", "placed", "mean", "s", "s placed")
    return [Section("Least deflection along a path", columns, tuple(rows), tuple(figures))]


def _evaluate(number: int, angle: int) -> Outcome:
    """Turn and place one path, whose arm, shape and place follow from its number."""
    draw = np.random.default_rng(1_000 * angle + number)
    robots = {each.name: each.robot for each in build_nominal_robots()}
    robot = robots[ARMS[number % len(ARMS)]]
    prior = build_prior_model(robot)
    compliance = prior.compliance * 2.0 ** draw.uniform(-1.0, 1.0, robot.n)
    model = JointModel(robot, compliance, None, Constraints(Bounds.positive(robot.n)))
    inverse = InverseKinematics(robot)
    for path in _draw_paths(robot, number, angle, draw):
        begin = process_time()
        try:
            choice = choose_turns(model, inverse, path, TASK)
        except RequestError:
            continue  # the arm does not follow this path at any turn: draw another place
        seconds = process_time() - begin
        begin = process_time()
        placed = _place(model, inverse, path) / choice.median_fixed
        seconds_placed = process_time() - begin
        best = float(choice.fixed.min()) / choice.median_fixed
        return Outcome(choice.size / choice.median_fixed, best, placed, seconds, seconds_placed)
    raise ValueError(f"path {number} is reached nowhere")


def _draw_paths(robot: Robot, number: int, angle: int, draw: np.random.Generator) -> Iterator[ProcessPath]:
    """Yield paths of one shape at random places in front of the arm."""
    for _ in range(100):
        centre = reach_centre(robot, draw.uniform(0.5, 0.75), draw.uniform(0.1, 0.4), draw.uniform(-0.3, 0.3))
        yield process_path(
            list(SHAPES)[number % len(SHAPES)],
            centre,
            yaw=draw.uniform(0.0, 2.0 * np.pi),
            count=POINTS,
            angle=np.radians(angle),
        )


def _place(model: JointModel, inverse: InverseKinematics, path: ProcessPath) -> float:
    """Return the least deflection in a box around the path, as `process` searches places [m]."""
    reach = measure_reach(model.robot)
    half = reach * np.array([0.25, 0.35, 0.15])
    box = PlaceBox(path.middle - half, path.middle + half, GRID, 2.0 * np.pi * np.arange(8) / 8)
    coarse, task, first = coarsen(path, TASK, np.arange(len(path)))
    places = box.places()

    def evaluate(trials: FloatArray) -> FloatArray:
        return evaluate_places(model, inverse, coarse, task, trials, first)

    sizes = evaluate(places)
    order = np.argsort(sizes)[:5]
    found = [places[i] for i in order.tolist()]
    found += [search_around(box, places[i], float(sizes[i]), evaluate)[0] for i in order[:2].tolist()]
    best = np.inf
    for place in found:
        try:
            moved = path.move(place[:3] - path.middle, float(place[3]))
            best = min(best, choose_turns(model, inverse, moved, TASK).size)
        except RequestError:
            continue  # the coarse path can be followed there, but not the whole one
    return float(best)
