"""Other robots than the chosen one, for which the targets keep their places on the flange."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.finding import AdvisedAction, Finding
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.integrity.against_model import (
    EXPLAINED,
    LARGEST_MODEL_ERROR,
    LEAST_ROWS,
    find_consensus_places,
    greatest_distances,
    sample_rows,
)
from jointstiff.solver.integrity.values import View, median, transform_to_flange
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import KnownRobot, Robot
from jointstiff.solver.text import length_text

LARGEST_NOMINAL_ERROR: Final = 5e-3
"""Greatest distance of a target from its place [m] by the nominal model of the robot that was measured.

A robot differs from its nominal model by 1 mm to 3 mm, and from other types of robots by centimetres.
"""
CLEARLY: Final = 0.1
"""Fraction of the observations that another robot must explain in addition to those of the chosen robot."""
ALIKE: Final = 1.5
"""Ratio of median distances up to which positions do not distinguish two robots."""
_MICROMETRES: Final = 6
"""Decimals to which median distances [m] are rounded before two robots are compared."""


@dataclass(frozen=True, eq=False)
class _Fit:
    """Known robot whose model gives the targets the same places on the flange in most observations."""

    known: KnownRobot  #: the robot
    #: number of explained observations: all targets are within `LARGEST_NOMINAL_ERROR` of their usual places
    explained: int
    greatest_distance: float  #: greatest distance of a target from its usual place in these observations [m]
    median_distance: float  #: median over all observations of the greatest distance of a target [m]


def inspect_other_robots(view: View, others: Iterable[KnownRobot]) -> Iterator[Finding]:
    """Report other robots that explain the positions better than the chosen robot, the best first.

    A robot explains an observation if the targets are at their usual places on its flange, within
    `LARGEST_NOMINAL_ERROR`. The robot is reported if it explains the fraction `EXPLAINED` of the
    observations, and the chosen robot explains clearly fewer, within `LARGEST_MODEL_ERROR`.

    Args:
        view: measurement set with the chosen robot.
        others: robots to try; robots with other kinds of joints are skipped.
    """
    # A target that was read only once has no usual place.
    is_compared = view.measured & (view.measured.sum(axis=0) > 1)
    rows = sample_rows(np.flatnonzero(is_compared.any(axis=1)))
    if len(rows) < LEAST_ROWS:
        return
    sample, is_compared, fits = view.measurements[rows], is_compared[rows], []
    chosen_distances = _measure_target_distances(view.robot, sample, is_compared)
    explained_by_chosen = int((chosen_distances <= LARGEST_MODEL_ERROR).sum())
    for known in others:
        if known.robot.joint_kinds != view.robot.joint_kinds:
            continue
        distances = _measure_target_distances(known.robot, sample, is_compared)
        is_explained = distances <= LARGEST_NOMINAL_ERROR
        count = int(is_explained.sum())
        if count >= EXPLAINED * len(rows) and count > explained_by_chosen + CLEARLY * len(rows):
            fits.append(_Fit(known, count, float(distances[is_explained].max()), median(distances)))
    fits.sort(key=lambda fit: (-fit.explained, round(fit.median_distance, _MICROMETRES)))
    for fit in fits:
        equals = [f"'{each.known.name}'" for each in fits if each is not fit and _are_alike(each, fit)]
        tie = f"; {' and '.join(equals)} fit{'s' if len(equals) == 1 else ''} as well" if equals else ""
        name = fit.known.name
        yield view.build_finding(
            "another_robot_fits",
            f"with the robot '{name}', the targets keep their places on the flange in {fit.explained} "
            f"of {len(rows)} observations, within {length_text(fit.greatest_distance)}; with the chosen "
            f"robot, in only {explained_by_chosen} of {len(rows)}, within "
            f"{length_text(LARGEST_MODEL_ERROR)}{tie}",
            f"check which robot was measured; if '{name}' was measured, choose this robot",
            "do_not_use",
            AdvisedAction.of("choose_robot", robot=name, robot_id=fit.known.identifier),
        )


def _measure_target_distances(robot: Robot, sample: Measurements, is_compared: BoolArray) -> FloatArray:
    """Return for each observation the greatest distance of a target from its usual place on the flange.

    Args:
        robot: robot that may have been measured.
        sample: M observations of T targets.
        is_compared: (M, T) mask of the targets that are compared.

    Returns:
        (M,) distances [m].
    """
    postures = Postures(robot, robot.joint_map.model_angles(sample.joints))
    in_flange = transform_to_flange(postures, sample.position, is_compared)
    return greatest_distances(in_flange, find_consensus_places(in_flange))


def _are_alike(first: _Fit, second: _Fit) -> bool:
    """Return whether two robots explain the positions about equally well."""
    smaller, larger = sorted(round(fit.median_distance, _MICROMETRES) for fit in (first, second))
    return larger <= ALIKE * smaller
