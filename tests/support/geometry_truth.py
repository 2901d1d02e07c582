"""Sweeps and poses of an arm whose geometry is known, and what tests compare with it.

The readings are those of `jointstiff.simulator.sweeps`, which shares no code with the solver.
"""

import re
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin
from support.shared_data import shared

from jointstiff.simulator import default_arm
from jointstiff.simulator.sweeps import HOME, SWEEP_TARGETS, SWEEPS, TrackedArm, imperfect_arm, rotation_by
from jointstiff.simulator.urdf import urdf_text
from jointstiff.solver.geometry.poses import Axis, IdentifiedAxes
from jointstiff.solver.geometry.sweeps import Sweep, SweepSet, SweptAxes, identify_axes
from jointstiff.solver.mechanics.chain import KinematicChain
from jointstiff.solver.mechanics.robot import JointMap
from jointstiff.solver.mechanics.urdf import read_urdf

__all__ = [
    "FANUC_MAP",
    "HOME",
    "NAMES",
    "SIGMA",
    "TARGETS",
    "Cell",
    "axes_of_noisy_sweeps",
    "axis_covariance",
    "axis_errors",
    "chi_square",
    "chi_squares",
    "imperfect_arm",
    "nominal",
    "rodrigues",
    "shared_chain",
    "shared_sweeps",
    "swept",
    "with_sweep",
]

SIGMA = 15e-6
TARGETS = SWEEP_TARGETS
NAMES = ("P10", "P11", "P12")
FANUC_MAP = np.diag([1.0, 1.0, -1.0, -1.0, -1.0, -1.0])
FANUC_MAP[2, 1] = -1.0
rodrigues = rotation_by


@dataclass(frozen=True, eq=False)
class Cell(TrackedArm):
    """A tracked arm, its sweeps and its truth as the solver's types."""

    def sweeps(
        self,
        rng: np.random.Generator | None = None,
        *,
        count: int = 15,
        sigma: float = SIGMA,
        home: np.ndarray = HOME,
        stated: bool = True,
    ) -> SweepSet:
        """Each controller joint turned alone; exact without a generator."""
        parts = tuple(
            swept(self, joint, self.sweep(joint, np.linspace(*SWEEPS[joint], count), home), rng, sigma)
            for joint in range(len(home))
        )
        names = tuple(f"P{10 + t}" for t in range(len(self.targets)))
        return SweepSet(parts, names, JointMap(self.matrix, np.zeros(len(home))), sigma if stated else None)

    def axis_at(self, joint: int, controller: np.ndarray) -> Axis:
        """The true axis in the tracker's frame in a posture."""
        return Axis.through(*self.axis(joint, controller))

    @property
    def tracker_to_base(self) -> pin.SE3:
        return pin.SE3(self.rotation.T, -self.rotation.T @ self.translation)


def swept(
    cell: TrackedArm,
    joint: int,
    angles: np.ndarray,
    rng: np.random.Generator | None = None,
    sigma: float = SIGMA,
) -> Sweep:
    """A sweep of one joint at these angles (N, n) [rad]; exact without a generator."""
    points = cell.readings(angles)
    if rng is not None:
        points = points + rng.normal(0.0, sigma, points.shape)
    return Sweep(angles, points, np.ones(points.shape[:2], dtype=bool), f"joint_{joint + 1}", joint)


def with_sweep(sweeps: SweepSet, joint: int, *others: Sweep) -> SweepSet:
    """The set with others in place of the sweep of a joint."""
    return replace(sweeps, sweeps=(*sweeps.sweeps[:joint], *others, *sweeps.sweeps[joint + 1 :]))


def nominal() -> KinematicChain:
    """The arm as its maker has it."""
    return read_urdf(urdf_text(default_arm()), "base_link", "flange")


def axis_errors(found: IdentifiedAxes, cell: TrackedArm) -> np.ndarray:
    """Charts (6, 4) of the true axes about the identified ones, at angle zero."""
    return np.array([found.axes[j].chart(Axis.through(*cell.axis(j, np.zeros(6)))) for j in range(6)])


def axis_covariance(found: IdentifiedAxes, joint: int) -> np.ndarray:
    """Covariance (4, 4) of one axis."""
    part = slice(4 * joint, 4 * joint + 4)
    return found.covariance[part, part]


def chi_squares(found: IdentifiedAxes, cell: TrackedArm) -> list[float]:
    """Squared errors of the axes (6,) in units of their covariances."""
    return [chi_square(e, axis_covariance(found, j)) for j, e in enumerate(axis_errors(found, cell))]


def chi_square(error: np.ndarray, covariance: np.ndarray) -> float:
    """Squared error in units of its covariance."""
    return float(error @ np.linalg.solve(covariance, error))


def shared_sweeps(stated: bool = True) -> tuple[SweepSet, dict[str, Any]]:
    """simulated/sweeps.json and its truth."""
    document, truth = shared("simulated/sweeps"), shared("simulated/truth")["sweeps"]
    parts = []
    for joint, sweep in enumerate(document["sweeps"]):
        angles = np.array([one["joints"] for one in sweep["observations"]])
        points = np.array([[one["targets"][name] for name in NAMES] for one in sweep["observations"]])
        parts.append(Sweep(angles, points, np.ones(points.shape[:2], dtype=bool), sweep["joint"], joint))
    sigma = document["noise"]["sigma"] if stated else None
    return SweepSet(tuple(parts), NAMES, JointMap.identity(6), sigma), truth


def shared_chain() -> KinematicChain:
    """The nominal model of the arm in simulated/sweeps.json."""
    model = shared("simulated/dead_weight_motor")["robot"]["model"]
    return read_urdf(model["urdf"], model["base"], model["flange"])


@lru_cache
def axes_of_noisy_sweeps(seed: int) -> SweptAxes:
    """Identify the axes of the default cell from sweeps with noise, once for all tests of a process."""
    return identify_axes(Cell().sweeps(np.random.default_rng(seed)))


_METRES = {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9}


def length_in(message: str) -> float:
    """The first length in a sentence [m]."""
    number, unit = re.search(r"([\d.]+) (nm|µm|mm|m)\b", message).groups()
    return float(number) * _METRES[unit]
