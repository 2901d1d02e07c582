"""Campaigns on arms of exact springs, as the solver takes them: exact once, with noise again and again."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jointstiff.simulator import TARGETS, SpringArm, deflections
from jointstiff.simulator.campaign import Experiment, plan_experiment
from jointstiff.simulator.urdf import BASE_LINK, FLANGE_LINK, urdf_text
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.urdf import read_urdf

SIGMA = 2e-5
"""Standard uncertainty of one coordinate of one reading [m]."""


def robot_of(arm: SpringArm) -> Robot:
    """The arm's kinematics and payload."""
    return Robot(read_urdf(urdf_text(arm), BASE_LINK, FLANGE_LINK).model(), payload=arm.payload)


def readings_of(
    joints: npt.ArrayLike,
    force: npt.ArrayLike,
    load_point: npt.ArrayLike,
    position: npt.ArrayLike,
    deflection: npt.NDArray[np.float64],
    **others: Any,
) -> Measurements:
    """Readings (N, T, 3), the loads as arrays (N, 3) or one for all; no moment, if nothing else is stated."""
    present = np.ones(deflection.shape[:2], dtype=np.bool_)
    loads = {"force": force, "moment": np.zeros(3), "load_point": load_point} | others
    rows = {
        name: np.array(np.broadcast_to(np.asarray(loads.pop(name), dtype=float), (len(present), 3)))
        for name in ("force", "moment", "load_point")
    }
    place = np.array(np.broadcast_to(np.asarray(position, dtype=float), deflection.shape))
    stated = {"in_flange": ~present, "present": present} | rows | loads
    return Measurements(joints=np.asarray(joints), position=place, deflection=deflection, **stated)


@dataclass(frozen=True, eq=False)
class SpringCampaign:
    """What exact instruments would read of an arm."""

    arm: SpringArm
    experiment: Experiment
    unloaded: npt.NDArray[np.float64]
    loaded: npt.NDArray[np.float64]

    @classmethod
    def of(cls, arm: SpringArm, *, configurations: int = 19, seed: int = 0, force: float = 1500.0) -> Self:
        """Pull in all directions."""
        return cls.by(
            arm, plan_experiment(arm, configurations=configurations, load="pull", force=force, seed=seed)
        )

    @classmethod
    def by(cls, arm: SpringArm, plan: Experiment) -> Self:
        """Balance springs and loads of an experiment."""
        points = np.array(list(TARGETS.values()))
        return cls(arm, plan, *deflections(arm, plan.joints, *plan.wrenches, points))

    def measured(self, draws: int, *, seed: int, sigma: float = SIGMA) -> Iterator[Measurements]:
        """Campaigns with noise of their own."""
        generator = np.random.default_rng(seed)
        exact = np.stack([self.unloaded, self.loaded])
        for _ in range(draws):
            yield self.measurements(*(exact + sigma * generator.standard_normal(exact.shape)), sigma=sigma)

    def measurements(
        self, unloaded: npt.NDArray[np.float64], loaded: npt.NDArray[np.float64], *, sigma: float | None
    ) -> Measurements:
        """Positions read, (N, T, 3) each."""
        plan = self.experiment
        loads = (plan.joints, plan.forces, plan.load_points)
        return readings_of(*loads, unloaded, loaded - unloaded, moment=plan.moments, sigma=sigma)


def load_cases(
    arm: SpringArm, count: int = 6, *, force: float = 800.0, moment: float = 60.0, seed: int = 2
) -> LoadCases:
    """Loads in all directions in the middle half of each joint's range, at one place of the tool."""
    generator = np.random.default_rng(seed)
    low, high = arm.limits.T
    q = 0.5 * (low + high) + 0.25 * (high - low) * generator.uniform(-1, 1, (count, len(low)))
    pull = generator.standard_normal((count, 3))
    return LoadCases(
        joints=q,
        force=force * pull / np.linalg.norm(pull, axis=1, keepdims=True),
        moment=moment * generator.standard_normal((count, 3)),
        load_point=np.tile([0.0, 0.1, 0.15], (count, 1)),
        place=np.tile([0.05, -0.08, 0.21], (count, 1)),
    )
