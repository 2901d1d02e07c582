"""Campaigns on arms of exact springs, as the solver takes them: exact once, with noise again and again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from jointstiff.simulator import TARGETS, SpringArm, deflections
from jointstiff.simulator.campaign import Experiment, plan_experiment
from jointstiff.simulator.urdf import BASE_LINK, FLANGE_LINK, urdf_text
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.urdf import read_urdf

SIGMA = 2e-5
"""Standard uncertainty of one coordinate of one reading [m]."""


def robot_of(arm: SpringArm) -> Robot:
    """The arm's kinematics."""
    return Robot(read_urdf(urdf_text(arm), BASE_LINK, FLANGE_LINK))


@dataclass(frozen=True, eq=False)
class SpringCampaign:
    """What exact instruments would read of an arm."""

    arm: SpringArm
    experiment: Experiment
    unloaded: npt.NDArray[np.float64]
    loaded: npt.NDArray[np.float64]

    @classmethod
    def of(cls, arm: SpringArm, *, configurations: int = 19, seed: int = 0) -> SpringCampaign:
        """Pull in all directions."""
        plan = plan_experiment(arm, configurations=configurations, load="pull", force=1500.0, seed=seed)
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
        present = np.ones(unloaded.shape[:2], dtype=np.bool_)
        plan = self.experiment
        return Measurements(
            joints=plan.joints,
            force=plan.forces,
            moment=plan.moments,
            load_point=plan.load_points,
            position=unloaded,
            in_flange=~present,
            deflection=loaded - unloaded,
            present=present,
            sigma=sigma,
        )
