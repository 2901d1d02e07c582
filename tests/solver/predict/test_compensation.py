"""Compensated commands against springs that balance loads exactly, by code that shares nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import prepare

from jointstiff.simulator import default_arm, equilibrium
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign, elastic_deflections
from jointstiff.simulator.urdf import BASE_LINK, FLANGE_LINK, urdf_text
from jointstiff.solver.convex.problem import Bounds, Constraints
from jointstiff.solver.links.choice import Folds, Plan
from jointstiff.solver.links.fit import estimate_elastic
from jointstiff.solver.links.model import ElasticColumns, ElasticModel
from jointstiff.solver.predict.forward import CorrectionLimits, LoadCases, compensate
from jointstiff.solver.predict.models import ElasticPredictor, JointModel
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.robot.urdf import read_urdf

ARM = default_arm()
ROBOT = Robot(read_urdf(urdf_text(ARM), BASE_LINK, FLANGE_LINK))
MODEL = JointModel(ROBOT, ARM.compliances, None, Constraints(Bounds.positive(6)))
COUNT = 40


def path(force=1500.0):
    generator = np.random.default_rng(5)
    low, high = ARM.limits.T
    joints = 0.5 * (low + high) + 0.25 * (high - low) * generator.uniform(-1, 1, (COUNT, 6))
    direction = generator.standard_normal((COUNT, 3))
    point = np.broadcast_to([0.0, 0.05, 0.25], (COUNT, 3)).copy()
    return LoadCases(
        joints=joints,
        force=force * direction / np.linalg.norm(direction, axis=1, keepdims=True),
        moment=np.zeros((COUNT, 3)),
        load_point=point,
        place=point.copy(),
    )


def exact_place(joints, cases):
    """Place (m, 3) in R0 and axes (m, 3, 3) of the flange once springs balance the load."""
    q = joints + equilibrium(ARM, joints, cases.force, cases.moment, cases.load_point)
    posture = ARM.posture(q)
    return posture.point_to_base(cases.place), posture.flange_rotation


def test_the_loaded_tool_is_where_it_is_wanted():
    wanted = path()
    found = compensate(MODEL, wanted, CorrectionLimits(1.0, 1.0))
    still = ARM.posture(wanted.joints)
    place, axes = exact_place(found.commanded, wanted)
    np.testing.assert_allclose(place, still.point_to_base(wanted.place), rtol=0, atol=1e-12)
    np.testing.assert_allclose(axes, still.flange_rotation, rtol=0, atol=1e-12)
    assert np.abs(found.residual).max() < 1e-12
    np.testing.assert_allclose(found.share, 1.0)


def test_the_mirror_is_worse_by_orders_of_magnitude():
    """The mirror x − δ(x) of the literature, with the exact deflection at the wanted posture."""
    wanted = path()
    found = compensate(MODEL, wanted, CorrectionLimits(1.0, 1.0))
    deflection = equilibrium(ARM, wanted.joints, wanted.force, wanted.moment, wanted.load_point)
    mirrored, _ = exact_place(wanted.joints - deflection, wanted)
    goal = ARM.posture(wanted.joints).point_to_base(wanted.place)
    assert np.linalg.norm(mirrored - goal, axis=1).max() > 1e-6
    assert np.linalg.norm(found.residual[:, :3], axis=1).max() < 1e-12


def test_uncorrected_is_the_exact_deflection():
    wanted = path()
    found = compensate(MODEL, wanted)
    place, _ = exact_place(wanted.joints, wanted)
    np.testing.assert_allclose(
        found.uncorrected[:, :3], place - ARM.posture(wanted.joints).point_to_base(wanted.place), atol=1e-12
    )


def test_limits_hold_corrections_back_and_say_so():
    found = compensate(MODEL, path(), CorrectionLimits(displacement=5e-4))
    size = np.linalg.norm(found.correction[:, :3], axis=1)
    assert found.capped.any()
    assert size.max() < 5e-4 * 1.01
    np.testing.assert_allclose(size[found.capped], 5e-4, rtol=0.01)
    assert (np.linalg.norm(found.residual[found.capped, :3], axis=1) > 1e-6).all()
    assert (np.linalg.norm(found.residual[~found.capped, :3], axis=1) < 1e-12).all()


def test_ramps_begin_where_the_load_sets_in():
    wanted = path()
    force = wanted.force.copy()
    force[:5] = force[-5:] = 0.0
    wanted = replace(wanted, force=force)
    found = compensate(MODEL, wanted, CorrectionLimits(1.0, 1.0, ramp=1.0))
    assert found.share[5] == pytest.approx(0.0)
    assert found.share[20] == pytest.approx(1.0)
    assert (np.diff(found.share[5:8]) >= 0).all()
    np.testing.assert_allclose(found.correction[:5], 0.0, atol=1e-15)


def test_no_load_is_no_correction():
    found = compensate(MODEL, path(force=1e-300))
    assert np.abs(found.correction).max() < 1e-15


@pytest.fixture(scope="module")
def links():
    """Exact beams, read and fitted."""
    document = elastic_campaign(beam_arm(ARM), configurations=30, sigma=2e-5, seed=3)
    robot, measurements = prepare(document)
    columns = ElasticColumns(6, tuple(range(6)))
    folds = Folds(robot, measurements, columns, np.ones(6, dtype=bool), Plan(folds=3, weights=(1e-4,)))
    model = ElasticModel("joints_and_links", columns)
    return ElasticPredictor.of(robot, estimate_elastic(robot, measurements, folds, model, 1e-4))


def exact_beams(joints, cases):
    """Exact places (m, 3) of beams in balance, without load and with it: code that shares nothing."""
    places = cases.place[:1]
    still, loaded = elastic_deflections(beam_arm(ARM), joints, cases.force, cases.load_point, places)
    return still[:, 0], loaded[:, 0]


def test_as_much_is_compensated_as_is_predicted(links):
    wanted = path()
    found = compensate(links, wanted, CorrectionLimits(1.0, 1.0))
    assert np.abs(found.residual).max() < 1e-11
    goal, loaded = exact_beams(wanted.joints, wanted)
    size = np.linalg.norm(loaded - goal, axis=1).mean()
    predicted = 1.0 - np.linalg.norm(loaded - goal - found.uncorrected[:, :3], axis=1).mean() / size
    reached = exact_beams(found.commanded, wanted)[1]
    compensated = 1.0 - np.linalg.norm(reached - goal, axis=1).mean() / size
    assert predicted > 0.97
    assert compensated == pytest.approx(predicted, abs=1e-3)


def test_a_share_is_left(links):
    wanted = path()
    whole = compensate(links, wanted, CorrectionLimits(1.0, 1.0))
    most = float(np.median(np.linalg.norm(whole.correction[:, :3], axis=1)))
    found = compensate(links, wanted, CorrectionLimits(most, 1.0))
    assert found.capped.sum() == COUNT // 2
    assert np.linalg.norm(found.correction[:, :3], axis=1).max() < most * 1.01
    assert np.linalg.norm(found.residual[~found.capped, :3], axis=1).max() < 1e-11


def test_the_place_follows_from_rows_and_from_blocks_alike(links):
    found = links.deflect(path())
    np.testing.assert_allclose(found.motion, found.rows @ links.entries, atol=1e-15)
