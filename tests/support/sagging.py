"""Campaigns of an arm that bends under its own weight, as the solver takes them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointstiff.simulator import TARGETS, SpringArm, default_arm, random_configurations, robot_document
from jointstiff.simulator.own_weight import Balancer, Bodies, default_bodies, sag
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.weight_rows import Balancer as StatedBalancer
from jointstiff.solver.fit.weight_rows import Burden, StatedLoads, WeightReadings, list_errors_of_loads
from jointstiff.solver.geometry.poses import Poses
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.mechanics.robot import Body, JointMap, Robot
from jointstiff.solver.mechanics.urdf import read_urdf

ARM, BODIES = default_arm(), default_bodies()
SPRING = Balancer(3e4, 0.3, np.array([-0.2, 0.0, 0.5]), 1, np.array([-0.3, 0.0, 0.2]))
"""A balancer of 9 kN at its free length."""
POINTS = np.array(list(TARGETS.values()))
LOAD_POINT = np.array([-0.06, 0.02, 0.18])


def _robot_of(arm: SpringArm) -> Robot:
    model = robot_document(arm)["model"]
    return Robot(read_urdf(model["urdf"], model["base"], model["flange"]).model())


ROBOT = _robot_of(ARM)
OFF = replace(BODIES, masses=BODIES.masses * (1.0 + 0.08 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])))
"""Bodies whose masses are 8 % off."""


def stated_spring(
    rate: tuple[float, float] = (2.7e4, 3.3e4), pull: tuple[float, float] = (8e3, 1e4)
) -> StatedBalancer:
    """State the balancer within bounds."""
    return StatedBalancer(1, (-0.2, 0.0, 0.5), (-0.3, 0.0, 0.2), rate, pull)


def burden_of(
    bodies: Bodies, relative: float = 0.0, radius: float = 0.0, balancers: Sequence[StatedBalancer] = ()
) -> Burden:
    stated = zip(bodies.masses.tolist(), bodies.centres.tolist(), strict=True)
    links = [
        Body.within(f"link_{j + 1}", j, mass, tuple(centre), relative=relative, radius=radius)
        for j, (mass, centre) in enumerate(stated)
    ]
    return Burden(tuple(links), tuple(balancers))


def campaign(
    *,
    seed: int = 0,
    arm: SpringArm | None = None,
    bodies: Bodies | None = None,
    stated: Burden | None = None,
    postures: int = 40,
    sigma: float = 3e-5,
    payload: float = 0.0,
    balancer: Balancer | None = None,
) -> WeightReadings:
    """Read an arm unloaded; with a payload [kg], once more in the same postures with that hung on."""
    arm, bodies = arm or ARM, bodies or BODIES
    q = random_configurations(arm, postures, seed)
    loads = [np.zeros(3), payload * bodies.gravity][: 2 if payload else 1]
    states = [q + sag(arm, bodies, q, force=f, load_point=LOAD_POINT, balancer=balancer) for f in loads]
    places = np.concatenate([arm.posture(state).targets_to_base(POINTS) for state in states])
    places = places + sigma * np.random.default_rng([seed, 77]).standard_normal(places.shape)
    angles = np.tile(q, (len(loads), 1))
    present = np.ones(places.shape[:2], dtype=bool)
    poses = Poses(angles, places, present, tuple(TARGETS), JointMap.identity(6), sigma=sigma or None)
    burden = stated or burden_of(bodies)
    return WeightReadings(
        ROBOT,
        poses,
        burden,
        carried=np.ones((len(angles), len(burden.bodies))),
        force=np.repeat(loads, postures, axis=0),
        moment=np.zeros((len(angles), 3)),
        load_point=np.tile(LOAD_POINT, (len(angles), 1)),
    )


def state_loads(readings: WeightReadings, uncertainty: CommonUncertainty) -> WeightReadings:
    """State uncertainties of the payload of a campaign, under which the second half of positions was read."""
    before, after = np.split(readings.poses.points, 2)
    unloaded = len(before)
    present = readings.poses.present[unloaded:]
    under_load = Measurements(
        joints=readings.poses.angles[unloaded:],
        position=before,
        deflection=after - before,
        present=present,
        in_flange=~present,
        force=readings.force[unloaded:],
        moment=readings.moment[unloaded:],
        load_point=readings.load_point[unloaded:],
        sigma=readings.poses.sigma,
        common_uncertainty=uncertainty,
    )
    terms = list_errors_of_loads(under_load)
    loads = StatedLoads(Rows(readings.robot, under_load), terms, unloaded)
    return replace(readings, stated=loads if terms else None)
