"""Places of the workpiece: position and turn about the vertical with the least deflection along its path."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.predict.forward import ForwardModel
from jointstiff.solver.process.knots import find_knots
from jointstiff.solver.process.path import ProcessPath
from jointstiff.solver.process.turning import TurnTask, estimate_least

FLAT: Final = 0.05
"""Relative difference from the least deflection within which a place counts as nearly as good."""
COARSE_POINTS: Final = 20
"""Points by length that are evaluated at each place of a search; the best places are evaluated in full."""
_MOST_COARSE: Final = 40
"""Greatest number of these points with corners and ends of the load; of more, some are chosen evenly."""
COARSE_TURNS: Final = 18
"""Turns that are tried at each place of a search."""
_HALVINGS: Final = 3
"""Times that the steps of the search around a good place are halved."""


@dataclass(frozen=True, eq=False)
class PlaceBox:
    """Box of places: positions of the path's centre in R0, and turns about the z axis through the centre."""

    low: FloatArray  #: (3,) least coordinates [m]
    high: FloatArray  #: (3,) greatest coordinates [m]
    grid: tuple[int, int, int]  #: number of positions along x, y and z
    angles: FloatArray  #: (A,) turns about z, from the workpiece as it is [rad]

    def places(self) -> FloatArray:
        """Return the places (P, 4) of the grid: position of the path's centre [m], then turn [rad].

        If an axis has one position, it is the middle of the box.
        """
        axes = [
            np.linspace(low, high, count) if count > 1 else np.array([0.5 * (low + high)])
            for low, high, count in zip(self.low, self.high, self.grid, strict=True)
        ]
        mesh = np.meshgrid(*axes, self.angles, indexing="ij")
        return np.stack([each.ravel() for each in mesh], axis=1)

    def steps(self) -> FloatArray:
        """Return the distances (4,) of neighbouring places of the grid [m, rad]; zero along a fixed axis."""
        count = np.array(self.grid)
        step = np.where(
            count > 1, (self.high - self.low) / np.maximum(count - 1, 1), 0.5 * (self.high - self.low)
        )
        turn = float(np.diff(self.angles).min()) if len(self.angles) > 1 else 0.0
        return np.append(step, turn)

    def clip(self, place: FloatArray) -> FloatArray:
        """Return a place (4,) moved into the box."""
        inside = place.copy()
        inside[:3] = np.clip(inside[:3], self.low, self.high)
        return inside


def evaluate_places(
    model: ForwardModel,
    inverse: InverseKinematics,
    path: ProcessPath,
    task: TurnTask,
    places: FloatArray,
    first: IndexArray | None = None,
) -> FloatArray:
    """Return the smallest deflection (P,) of the path at each place, over all sequences of joint angles [m].

    The deflection is computed to first order in the load. It is NaN where no sequence stays within the joint
    limits of positions and speeds.

    Args:
        model: model of the loaded robot.
        inverse: inverse kinematics of the same robot.
        path: path of the workpiece where it is now.
        task: turns and motion, such as from `coarsen`.
        places: (P, 4) positions of the path's centre [m], then turns about z [rad].
        first: (m,) for each point, index of the earliest point with the same target; None if all differ.
    """
    sizes = np.full(len(places), np.nan)
    middle = path.middle
    for i, place in enumerate(places):
        try:
            moved = path.move(place[:3] - middle, float(place[3]))
            sizes[i] = estimate_least(model, inverse, moved, task, first)
        except RequestError:
            continue  # the robot does not reach the path there, within its limits
    return sizes


def coarsen(path: ProcessPath, task: TurnTask, first: IndexArray) -> tuple[ProcessPath, TurnTask, IndexArray]:
    """Return a path with fewer points and a task with fewer turns, for the search of places.

    Points are kept by length, with corners and ends of the load. Limits of speed and rate are those of the
    whole path. Points with a given posture are left out, because they do not move with the workpiece.
    """
    free = np.flatnonzero(np.isnan(path.given[:, 0]))
    if not len(free):
        raise RequestError(
            "all targets of the program are joint angles, which do not move with the workpiece",
            where="place",
            remedy="send a program with targets that are poses",
        )
    path, _ = task.steady(path, first)
    part = path.select(free)
    spacing = max(float(part.lengths[-1]) / COARSE_POINTS, 1e-6)
    distinct = np.arange(len(free))
    number = find_knots(part, spacing, distinct)
    if len(number) > _MOST_COARSE:
        loaded = np.flatnonzero(part.loaded[number])
        chosen = [_choose_evenly(np.arange(len(number))), _choose_evenly(loaded)]
        number = number[np.union1d(*chosen)]
    if task.greatest:  # the greatest deflection is likely where the force is greatest
        number = np.union1d(number, np.argmax(np.linalg.norm(part.force, axis=1)))
    kept = free[number]
    thinned = replace(part.select(number), centre=path.middle)
    # A target that occurs again is the same only if its first visit is kept, too.
    number_of = {int(target): i for i, target in reversed(list(enumerate(first[kept].tolist())))}
    same = np.array([number_of[target] for target in first[kept].tolist()], dtype=np.intp)
    every = max(1, len(task.angles) // COARSE_TURNS)
    return thinned, replace(task, angles=task.angles[::every], pace=task.pace.select(kept)), same


def _choose_evenly(numbers: IndexArray) -> IndexArray:
    """Return at most `COARSE_POINTS` of some numbers, evenly spread."""
    return numbers[:: max(1, int(np.ceil(len(numbers) / COARSE_POINTS)))]


def search_around(
    box: PlaceBox, place: FloatArray, size: float, evaluate: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, float]:
    """Search for a better place around a place of the grid, by steps that are halved where none is better.

    Args:
        box: box of places.
        place: (4,) place where the search starts [m, rad].
        size: deflection there [m].
        evaluate: function from places (k, 4) to deflections (k,) [m], NaN where there is none.

    Returns:
        The best place (4,), and its deflection [m].
    """
    step = 0.5 * box.steps()
    for _ in range(_HALVINGS):
        trials = np.array([box.clip(trial) for trial in _neighbours(place, step)]).reshape(-1, 4)
        trials = trials[(trials != place).any(axis=1)]
        if not len(trials):
            break
        sizes = evaluate(trials)
        if (sizes < size).any():
            best = int(np.nanargmin(sizes))
            place, size = trials[best], float(sizes[best])
        else:
            step = 0.5 * step
    return place, size


def _neighbours(place: FloatArray, step: FloatArray) -> Iterator[FloatArray]:
    """Yield the places one step away along each axis."""
    for axis in np.flatnonzero(step > 0.0).tolist():
        for sign in (1.0, -1.0):
            yield place + sign * step[axis] * np.eye(4)[axis]


@dataclass(frozen=True, eq=False)
class Flatness:
    """Places that are nearly as good as the best one."""

    count: int  #: number of places that were tried
    low: FloatArray  #: (4,) least position [m] and turn [rad] of these places
    high: FloatArray  #: (4,) greatest position [m] and turn [rad]


def find_flatness(places: FloatArray, sizes: FloatArray) -> Flatness:
    """Return the extent of the places whose deflection is within 5 % of the least.

    Args:
        places: (P, 4) places that were tried [m, rad].
        sizes: (P,) deflections, some of them known [m]; NaN where there is none.
    """
    good: BoolArray = np.asarray(sizes <= (1.0 + FLAT) * np.nanmin(sizes))
    near = np.unique(np.round(places[good], 9), axis=0)
    return Flatness(len(near), near.min(axis=0), near.max(axis=0))
