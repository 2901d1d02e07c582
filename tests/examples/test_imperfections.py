"""Arms that differ from their models: by the stated sizes, and bending as springs across the axes must."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.examples import examples

from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import LOAD_POINT, random_configurations
from jointstiff.simulator.elastic_links import beam_compliance
from jointstiff.simulator.imperfections import (
    with_link_errors,
)
from jointstiff.simulator.own_weight import Balancer, default_bodies, energy, sag

ARM = default_arm()


@given(st.floats(0, 0.05), st.floats(0, 0.1), st.integers(0, 10**6))
@examples(100)
def test_link_errors_have_the_stated_size(length, angle, seed):
    wrong = with_link_errors(ARM, length=length, angle=angle, seed=seed)
    nominal, found = (
        np.diff(np.vstack([np.zeros(3), arm.axis_points, arm.flange_translation]), axis=0)
        for arm in (ARM, wrong)
    )
    np.testing.assert_allclose(np.linalg.norm(found - nominal, axis=1), length, atol=1e-14)
    sine = np.linalg.norm(np.cross(ARM.axis_directions, wrong.axis_directions), axis=1)
    cosine = np.einsum("ji,ji->j", ARM.axis_directions, wrong.axis_directions)
    np.testing.assert_allclose(np.arctan2(sine, cosine), angle, atol=1e-14)


def test_another_seed_errs_in_another_direction():
    first, second = (with_link_errors(ARM, length=1e-3, angle=1e-3, seed=seed) for seed in (0, 1))
    assert np.abs(first.axis_points - second.axis_points).max() > 1e-4
    assert np.abs(first.axis_directions - second.axis_directions).max() > 1e-4


def test_a_beam_bends_as_the_tables_say():
    """Cantilever of length L: tip deflection F L³/3EI + F L/GA, tip rotation M L/EI, F L²/2EI."""
    length, bending, shear = 1.2, 3e6, 5e8
    C = beam_compliance([length, 0, 0], bending=bending, torsion=2e6, axial=1e9, shear=shear)
    # Force along y at the tip: about the origin it is a force and a moment F L about z.
    wrench = np.array([0.0, 1.0, 0.0, 0.0, 0.0, length])
    at_origin = C @ wrench
    tip = at_origin[1] + at_origin[5] * length
    assert tip == pytest.approx(length**3 / (3 * bending) + length / shear)
    assert at_origin[5] == pytest.approx(length**2 / (2 * bending))
    assert C[0, 0] == pytest.approx(length / 1e9)
    assert C[3, 3] == pytest.approx(length / 2e6)
    assert np.linalg.eigvalsh(C).min() >= 0.0


def test_the_sag_is_where_the_energy_has_its_minimum():
    bodies, q = default_bodies(), random_configurations(ARM, 20)
    spring = Balancer(3e4, 0.3, np.array([-0.2, 0.0, 0.5]), 1, np.array([-0.3, 0.0, 0.2]))
    force, point = np.array([[300.0, -200.0, -900.0]] * 20), np.tile(LOAD_POINT, (20, 1))
    theta = sag(ARM, bodies, q, force=force, load_point=point, balancer=spring)
    least = energy(ARM, bodies, q, theta, force, point, spring)
    for step in 1e-5 * np.eye(6):
        for sign in (-1.0, 1.0):
            assert (energy(ARM, bodies, q, theta + sign * step, force, point, spring) > least).all()
