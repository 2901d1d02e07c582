"""Mistakes of a long day, made on purpose in simulated campaigns of many kinds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.designs import Design
from jointstiff.schemas.finding import FindingCode
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import TARGETS, plan_experiment
from jointstiff.simulator.imperfections import with_link_errors
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.readings.measurements import Measurements

__all__ = ["MISTAKES", "Mistake", "Posted", "clean_set", "only_deflections"]

Generator = np.random.Generator

SIGMA = 2e-5
"""Of a coordinate of a reading [m]."""
LINK_ERROR, AXIS_ERROR = 3e-4, np.radians(0.02)
"""By which the links and axes of a real robot are not its model's."""
BUMPS = (5e-4, 3e-3)
"""Least and greatest displacement of a bumped target [m]."""
_STREAM = 50


@dataclass(frozen=True, eq=False)
class Posted:
    """A set as it is posted.

    Attributes:
        measurements: of N observations.
        degrees: whether the angles were said to be in degrees.
    """

    measurements: Measurements
    degrees: bool = False


@dataclass(frozen=True)
class Mistake:
    """One kind of mistake.

    Attributes:
        name: in words.
        make: it, in a clean set.
        codes: of the findings that name it.
        by_deflections: whether it is there to be made where only deflections were read.
    """

    name: str
    make: Callable[[Measurements, Generator], Posted]
    codes: frozenset[FindingCode]
    by_deflections: bool = True


def clean_set(seed: int, *, model_error: bool) -> Measurements:
    """A campaign without mistakes: 10 to 40 configurations, dead weight or pulls, sigma stated or not.

    Args:
        seed: of everything.
        model_error: whether links and axes differ from the model's by tenths of a millimetre.
    """
    generator = np.random.default_rng([seed, _STREAM])
    arm = default_arm("secondary" if generator.random() < 0.5 else "motor")
    experiment = plan_experiment(
        arm,
        configurations=int(generator.integers(10, 41)),
        load="pull" if generator.random() < 0.5 else "dead_weight",
        force=float(generator.uniform(800.0, 2500.0)),
        seed=seed,
    )
    real = with_link_errors(arm, length=LINK_ERROR, angle=AXIS_ERROR, seed=seed) if model_error else arm
    design = Design.of(real, experiment)
    measurements = next(design.measured(1, seed=seed, sigma=SIGMA))
    return measurements if generator.random() < 0.5 else replace(measurements, sigma=None)


def only_deflections(measurements: Measurements) -> Measurements:
    """The same where no position was read, and the targets' nominal places on the flange are given."""
    places = np.broadcast_to(np.array(list(TARGETS.values())), measurements.position.shape)
    return replace(measurements, position=places, in_flange=measurements.present)


def _length_unit(m: Measurements, generator: Generator) -> Posted:
    factor = 1e3 if generator.random() < 0.5 else 1e-3
    return Posted(
        replace(
            m,
            position=factor * m.position,
            deflection=factor * m.deflection,
            load_point=factor * m.load_point,
            sigma=None if m.sigma is None else factor * m.sigma,
        )
    )


def _angle_unit(m: Measurements, generator: Generator) -> Posted:
    if generator.random() < 0.5:
        return Posted(replace(m, joints=np.rad2deg(m.joints)))
    return Posted(replace(m, joints=np.deg2rad(m.joints)), degrees=True)


def _force_sign(m: Measurements, _: Generator) -> Posted:
    return Posted(replace(m, force=-m.force))


def _one_force_sign(m: Measurements, generator: Generator) -> Posted:
    force = m.force.copy()
    force[generator.integers(len(force))] *= -1.0
    return Posted(replace(m, force=force))


def _joint_sign(m: Measurements, generator: Generator) -> Posted:
    sign = np.ones(m.joints.shape[1])
    sign[generator.integers(len(sign))] = -1.0
    return Posted(replace(m, joints=sign * m.joints))


def _swapped_targets(m: Measurements, generator: Generator) -> Posted:
    position, deflection = m.position.copy(), m.deflection.copy()
    i, (a, b) = generator.integers(len(m)), generator.permutation(position.shape[1])[:2]
    for array in (position, deflection):
        array[i, [a, b]] = array[i, [b, a]]
    if m.in_flange.any():  # the place is that of the name
        position = m.position
    return Posted(replace(m, position=position, deflection=deflection))


def _swapped_joints(m: Measurements, generator: Generator) -> Posted:
    order = np.arange(m.joints.shape[1])
    a, b = generator.permutation(len(order))[:2]
    order[[a, b]] = b, a
    return Posted(replace(m, joints=m.joints[:, order]))


def _shifted_rows(m: Measurements, generator: Generator) -> Posted:
    """Shift readings to the next row, from some row on or throughout."""
    count = len(m)
    first = 0 if generator.random() < 0.3 else int(generator.integers(count - 2))
    order = np.arange(count)
    order[first:] = np.roll(order[first:], 1 if generator.random() < 0.5 else -1)
    return Posted(replace(m, position=m.position[order], deflection=m.deflection[order]))


def _bumped_target(m: Measurements, generator: Generator) -> Posted:
    """Move one target on the flange, from some reading on, unloaded or loaded."""
    count, targets = m.present.shape
    direction = generator.standard_normal(3)
    shift = generator.uniform(*BUMPS) * direction / np.linalg.norm(direction)
    t, first = generator.integers(targets), int(generator.integers(1, count))
    between = generator.random() < 0.5
    # The axes of the flange as the readings show them: the shift turns with it.
    frame = _frames(m.position)
    moved = np.einsum("nij,j->ni", frame, shift)
    position, deflection = m.position.copy(), m.deflection.copy()
    if between:
        deflection[first, t] += moved[first]
        first += 1
    position[first:, t] += moved[first:]
    return Posted(replace(m, position=position, deflection=deflection))


def _frames(position: FloatArray) -> FloatArray:
    """(N, 3, 3) axes fixed to the first three targets, in R0."""
    x = position[:, 1] - position[:, 0]
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    z = np.cross(x, position[:, 2] - position[:, 0])
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _duplicated_row(m: Measurements, generator: Generator) -> Posted:
    order = np.arange(len(m))
    copy, original = generator.permutation(len(order))[:2]
    order[copy] = original
    return Posted(m[order])


MISTAKES = (
    Mistake("mm/m", _length_unit, frozenset({"length_unit_suspect"})),
    Mistake("deg/rad", _angle_unit, frozenset({"angle_unit_suspect"})),
    Mistake("sign of all forces", _force_sign, frozenset({"force_sign_suspect"})),
    Mistake("sign of one force", _one_force_sign, frozenset({"deflection_against_force"})),
    Mistake("sign of one joint", _joint_sign, frozenset({"joint_sign_suspect"})),
    Mistake("swapped targets", _swapped_targets, frozenset({"targets_swapped"})),
    Mistake("swapped joints", _swapped_joints, frozenset({"joints_swapped"})),
    Mistake("shifted rows", _shifted_rows, frozenset({"observations_out_of_order"})),
    Mistake(
        "one bumped target",
        _bumped_target,
        frozenset({"target_moved", "targets_not_rigid"}),
        by_deflections=False,
    ),
    Mistake("one duplicated row", _duplicated_row, frozenset({"duplicated_observation"})),
)
