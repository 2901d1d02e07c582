"""One geometry: do sweeps need their circles, or is a bundle of poses enough?

The bundle is the fit of all axes and targets to all positions (`fit_poses`), from a nominal arm that is
centimetres and degrees off; today's ways are the circles of each sweep, and the bundle that starts there.
By name only: it takes a minute.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.report import Figure, Section
from benchmarks.studies.geometry import sweeps_of
from jointstiff.simulator import default_arm
from jointstiff.simulator.sweeps import TrackedArm, WornArm, imperfect_arm, rotation_by
from jointstiff.simulator.urdf import urdf_text
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import InputError
from jointstiff.solver.geometry.charts import Axis, RigidTransform
from jointstiff.solver.geometry.poses import PoseState, chain_axes, fit_poses
from jointstiff.solver.geometry.sweeps import (
    DISAGREEMENT,
    SweepSet,
    angle_probability,
    identify_axes,
    refine_axes,
)
from jointstiff.solver.robot.urdf import read_urdf

__all__ = ["run"]

SETS = 40
WAYS = ("circles, one by one", "bundle from circles", "bundle from nominal", "bundle, controller's angles")


@dataclass(frozen=True)
class World:
    """An arm that is not as its model has it."""

    name: str
    gear: float  # amplitude of the gears' errors [rad]
    sag: float  # greatest change of a target's displacement by weight within the sweeps [m]

    def cell(self, seed: int) -> TrackedArm:
        """Return an arm before its tracker."""
        if not (self.gear or self.sag):
            return TrackedArm(imperfect_arm(seed))
        return WornArm.random(seed, gear=self.gear, sag=self.sag)


WORLDS = (
    World("clean", 0.0, 0.0),
    World("gears 60 µrad", 60e-6, 0.0),
    World("sag 0.1 mm", 0.0, 1e-4),
    World("both", 60e-6, 1e-4),
)


def run(*, quick: bool) -> list[Section]:
    """Compare the axes that each way finds with the true ones."""
    sets = 4 if quick else SETS
    rows, figures, data = [], [], {}
    for world in WORLDS:
        errors: dict[str, list[FloatArray]] = {way: [] for way in WAYS}
        apart, contradicted, lost = [], 0, 0
        for seed in range(sets):
            cell = world.cell(seed)
            sweeps = sweeps_of(cell, np.random.default_rng([seed, 5]))
            alone = identify_axes(sweeps)
            together = refine_axes(alone)
            contradicted += angle_probability(alone, together) < DISAGREEMENT
            found = {WAYS[0]: alone.axes, WAYS[1]: together.axes}
            for way, free in ((WAYS[2], True), (WAYS[3], False)):
                try:
                    found[way] = bundle(sweeps, start(cell, sweeps, seed), free=free)
                except InputError:
                    lost += free
            if WAYS[2] in found:
                apart.append(float(charts(found[WAYS[1]], found[WAYS[2]]).max()))
            true = [Axis.through(*cell.axis(j, np.zeros(6))) for j in range(6)]
            for way, axes in found.items():
                errors[way].append(charts(true, axes))
        rms = {way: np.sqrt(np.square(errors[way]).mean(axis=(0, 1))) for way in WAYS}
        for way, (place, direction) in rms.items():
            rows.append((world.name, way, f"{1e6 * place:.0f} µm", f"{1e6 * direction:.0f} µrad"))
        said = (
            f"{contradicted} of {sets} fall back to the circles, {lost} bundles from nominal do not converge"
        )
        rows.append((world.name, said, "", ""))
        figures.append(
            Figure(
                f"bundle from nominal beside from circles, {world.name}", float(max(apart)), "at most", 1e-9
            )
        )
        data[world.name] = {
            "rms": {way: each.tolist() for way, each in rms.items()},
            "contradicted": contradicted,
            "lost": lost,
        }
    return [
        Section(
            title=f"One geometry: {sets} sets of sweeps at 15 µm, rms error of an axis",
            columns=("arm", "way", "place", "direction"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=("a bundle by the controller's angles is what own weight joins today",),
            data=data,
        )
    ]


def charts(axes: Sequence[Axis], others: Sequence[Axis]) -> FloatArray:
    """Return how far others are from axes (6, 2): in place at these [m], and in direction [rad]."""
    parts = [axis.chart(other) for axis, other in zip(axes, others, strict=True)]
    return np.array([[np.linalg.norm(part[:2]), np.linalg.norm(part[2:])] for part in parts])


def start(cell: TrackedArm, sweeps: SweepSet, seed: int) -> PoseState:
    """Return the nominal arm where the tracker is thought to see it: 2° and 50 mm off."""
    draws = np.random.default_rng([seed, 6])
    rotation = rotation_by(draws.standard_normal(3), np.radians(2.0)) @ cell.rotation
    translation = cell.translation + 0.05 * draws.uniform(-1.0, 1.0, 3)
    axes, flange = chain_axes(read_urdf(urdf_text(default_arm()), "base_link", "flange"))
    targets = flange.apply(cell.targets)
    placed = RigidTransform(rotation, translation)
    count = sum(len(sweep) for sweep in sweeps.sweeps)
    return PoseState(tuple(axis.moved(placed) for axis in axes), placed.apply(targets), np.zeros(count))


def bundle(sweeps: SweepSet, first: PoseState, *, free: bool) -> tuple[Axis, ...]:
    """Fit axes and targets to all positions; with the angle of each position free, or the controller's."""
    readings = sweeps.whitened
    if not free:
        readings = replace(readings, basis=np.zeros((len(readings.angles), 0)))
    return fit_poses(readings, first, where="sweeps")[0].axes
