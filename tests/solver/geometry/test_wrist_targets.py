"""Table I of the paper: the wrist centre by three targets with their offsets, beside own computations."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from support.geometry_truth import HOME, NAMES, TARGETS, Cell, nominal, rodrigues

from jointstiff.solver.geometry.frames import (
    FlangeConvention,
    find_base_frame,
    find_wrist_centre,
    identify_model,
)
from jointstiff.solver.geometry.sweeps import identify_axes

EXACT = 1e-9  # [m]
WRIST = (3, 4, 5)


def identified(sweeps):
    """The wrist's result and the identified model."""
    found = identify_axes(sweeps)
    base = find_base_frame(found, nominal())
    model = identify_model(found, base, FlangeConvention.from_chain(nominal()), nominal=nominal())
    return find_wrist_centre(found, base, model), model


def own_spheres(sweeps):
    """Distances (3,) of the targets from the common centre of their spheres, by SciPy."""
    points = np.concatenate([sweeps.sweeps[joint].points for joint in WRIST])  # (N, 3, 3)

    def gaps(unknowns):
        return (np.linalg.norm(points - unknowns[:3], axis=2) - unknowns[3:]).ravel()

    start = np.r_[points.mean(axis=(0, 1)), 0.3, 0.3, 0.3]
    return least_squares(gaps, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac").x[3:]


def own_flange(chain, angles):
    """Rotation and origin of the flange in R0, by Rodrigues' formula along the chain."""
    rotation, origin, turns = np.eye(3), np.zeros(3), iter(angles)
    for joint in chain.joints:
        origin = origin + rotation @ joint.translation
        rotation = rotation @ joint.rotation
        if joint.kind == "revolute":
            rotation = rotation @ rodrigues(joint.axis, next(turns))
    return rotation, origin


@pytest.fixture(scope="module")
def noisy():
    return Cell().sweeps(np.random.default_rng(93))


def test_of_exact_readings_the_offsets_are_those_of_the_arm():
    cell = Cell()
    wrist, _ = identified(cell.sweeps())
    arm = cell.arm
    centre = arm.flange_rotation.T @ (np.array(arm.axis_points[4]) - arm.flange_translation)
    offsets = np.array([each.offset for each in wrist.targets])
    np.testing.assert_allclose(offsets, TARGETS - centre, rtol=0.0, atol=EXACT)
    distances = [each.distance for each in wrist.targets]
    np.testing.assert_allclose(distances, np.linalg.norm(TARGETS - centre, axis=1), rtol=0.0, atol=EXACT)


def test_of_a_simulated_campaign_the_distances_are_those_of_own_spheres(noisy):
    wrist, _ = identified(noisy)
    assert [each.name for each in wrist.targets] == list(NAMES)
    assert all(each.trilaterates for each in wrist.targets)
    distances = [each.distance for each in wrist.targets]
    np.testing.assert_allclose(distances, own_spheres(noisy), rtol=0.0, atol=EXACT)


def test_of_a_simulated_campaign_the_offsets_are_those_of_own_kinematics(noisy):
    wrist, model = identified(noisy)
    rotation, origin = own_flange(model.chain, [*HOME[:3], 0.0, 0.0, 0.0])
    centre = rotation.T @ (np.array(wrist.combined.base) - origin)
    offsets = np.array([each.offset for each in wrist.targets])
    np.testing.assert_allclose(offsets, model.targets_in_flange - centre, rtol=0.0, atol=EXACT)


def test_uncertainties_of_distances_are_those_that_repeated_campaigns_show():
    """Of 60 distances, 95 % are within 1.96 standard uncertainties: at least 51."""
    cell = Cell()
    arm = cell.arm
    centre = arm.flange_rotation.T @ (np.array(arm.axis_points[4]) - arm.flange_translation)
    true = np.linalg.norm(TARGETS - centre, axis=1)
    inside = 0
    for seed in range(20):
        wrist, _ = identified(cell.sweeps(np.random.default_rng(seed)))
        for each, distance in zip(wrist.targets, true, strict=True):
            inside += abs(each.distance - distance) < 1.96 * each.standard_uncertainty
    assert inside >= 51


def test_the_largest_triangle_of_four_targets_is_named():
    """The first three lie on a line."""
    line = TARGETS[0] + np.outer([0.0, 0.5, 1.0], TARGETS[1] - TARGETS[0])
    wrist, _ = identified(Cell(targets=np.vstack([line, TARGETS[2]])).sweeps())
    assert [each.trilaterates for each in wrist.targets] == [True, False, True, True]
