"""The parts of the numerical core, each against mathematics it does not share."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag
from support.campaigns import prepare, simulated
from support.examples import examples
from support.shared_data import shared
from support.springs import robot_of

from jointstiff.simulator import default_arm
from jointstiff.solver.errors import JointstiffError, MeasurementError, UnsupportedMethodError
from jointstiff.solver.fitting.method import fit_displacement
from jointstiff.solver.fitting.observability import Spectrum, analyse
from jointstiff.solver.robot.configuration import Configurations, find_wrist
from jointstiff.solver.terms.block import regressor_blocks
from jointstiff.solver.triangle import Triangle, whitened, whitener


@pytest.fixture(scope="module")
def campaign():
    return simulated(load="pull", configurations=6, seed=2)


class TestConfigurations:
    def test_read_only(self, campaign):
        found = Configurations(campaign[0], campaign[1].joints)
        with pytest.raises(ValueError, match="read-only"):
            found.jacobian[0, 0, 0] = 1.0

    @pytest.mark.parametrize("q", [np.zeros((2, 5)), np.zeros(6), np.full((1, 6), np.nan)])
    def test_refuses(self, campaign, q):
        with pytest.raises(MeasurementError, match="joint angles have shape"):
            Configurations(campaign[0], q)


class TestTriangle:
    @examples(50)
    @given(cuts=st.lists(st.integers(0, 40), max_size=4), seed=st.integers(0, 2**32 - 1))
    def test_any_partition_keeps_every_residual(self, cuts, seed):
        rng = np.random.default_rng(seed)
        rows = rng.standard_normal((40, 5)) * 10.0 ** rng.uniform(-6, 6, 5)
        triangle = Triangle(joints=4)
        for part in np.split(rows, sorted(cuts)):
            triangle.add(part)
        assert triangle.rows == 40
        scale = np.linalg.norm(rows, axis=0)
        for _ in range(5):
            x = rng.standard_normal(5) / scale
            full, compressed = (np.linalg.norm(M @ x) for M in (rows, triangle.R))
            assert compressed == pytest.approx(full, rel=1e-12)


def displacement(block):
    """Rigid displacement (B, 6) of the barycentre, R of its covariance (RᵀR)⁻¹, and the barycentre."""
    Q, R, barycentre = fit_displacement(block)
    part = block.measurements
    d = whitened(part.covariance, part.deflection[..., None]).reshape(len(Q), -1, 1)
    return np.linalg.solve(R, Q.transpose(0, 2, 1) @ d)[..., 0], R, barycentre


class TestPose:
    @examples(30)
    @given(seed=st.integers(0, 2**32 - 1), targets=st.integers(3, 6))
    def test_recovers_a_rigid_displacement_exactly(self, seed, targets):
        rng = np.random.default_rng(seed)
        robot, measurements = simulated(load="pull", configurations=4)
        position = rng.uniform(-1, 1, (4, targets, 3))
        translation, rotation = rng.standard_normal((2, 4, 3)) * 1e-3
        arm = position - position.mean(axis=1, keepdims=True)
        moved = translation[:, None] + np.cross(rotation[:, None], arm)
        ones = np.ones((4, targets), dtype=bool)
        changed = replace(
            measurements, position=position, deflection=moved, present=ones, in_flange=~ones, targets=()
        )
        (block,) = regressor_blocks(robot, changed)
        x, _, _ = displacement(block)
        np.testing.assert_allclose(x, np.hstack([translation, rotation]), atol=1e-14)

    def test_covariance_follows_that_of_each_target(self, campaign):
        """A poor target counts little: the pose and its covariance are those of generalised least squares."""
        robot, measurements = campaign
        rng = np.random.default_rng(0)
        shape = measurements.present.shape
        root = rng.standard_normal((*shape, 3, 3))
        covariance = root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(3)
        (block,) = regressor_blocks(robot, replace(measurements, covariance=covariance))
        poses, R, barycentre = displacement(block)
        for i in range(len(measurements)):
            G = np.vstack(
                [np.hstack([np.eye(3), -_cross_matrix(p - barycentre[i])]) for p in block.points[i]]
            )
            weighted = G.T @ np.linalg.inv(block_diag(*covariance[i]))
            x = np.linalg.solve(weighted @ G, weighted @ measurements.deflection[i].ravel())
            np.testing.assert_allclose(poses[i], x, rtol=1e-8)
            np.testing.assert_allclose(R[i].T @ R[i], weighted @ G, rtol=1e-9)


class TestWhitener:
    @pytest.mark.parametrize(
        "bad",
        [
            np.diag([1.0, 1.0, 0.0]),
            np.diag([1.0, -1.0, 1.0]),
            np.array([[1.0, 0.5, 0], [0.2, 1.0, 0], [0, 0, 1.0]]),
            np.diag([1.0, np.nan, 1.0]),
            np.diag([1.0, np.inf, 1.0]),
        ],
    )
    def test_refuses_what_is_no_covariance(self, bad):
        with pytest.raises(MeasurementError, match="not finite, symmetric and positive definite"):
            whitener(bad)


class TestMeasurements:
    @pytest.mark.parametrize("name", ["joints", "force", "moment", "load_point", "position", "deflection"])
    def test_refuses_what_is_not_finite_and_wrong_shapes(self, campaign, name):
        _, measurements = campaign
        array = getattr(measurements, name).copy()
        array.flat[0] = np.nan
        with pytest.raises(MeasurementError, match="not finite") as refused:
            replace(measurements, **{name: array})
        assert refused.value.where == name
        with pytest.raises(MeasurementError, match="shape"):
            replace(measurements, **{name: getattr(measurements, name)[:-1].copy()})

    @pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf])
    def test_refuses_sigma(self, campaign, sigma):
        with pytest.raises(MeasurementError, match="sigma"):
            replace(campaign[1], sigma=sigma)

    def test_refuses_no_observation(self, campaign):
        with pytest.raises(MeasurementError, match="no observation"):
            campaign[1][:0]

    def test_names_follow_the_readings(self, campaign):
        _, measurements = campaign
        assert measurements.targets == ("P10", "P11", "P12")
        part = measurements[np.array([3, 0])]
        assert part.labels == ("c04", "c01")
        np.testing.assert_array_equal(part.force, measurements.force[[3, 0]])
        assert measurements[1:3].labels == ("c02", "c03")
        assert measurements.place(2) == "observations[2] 'c03'"
        plain = replace(measurements, labels=(), targets=())
        assert plain.labels == ("1", "2", "3", "4", "5", "6")
        assert plain.targets == ("1", "2", "3")

    @pytest.mark.parametrize("names", ["labels", "targets"])
    def test_names_of_another_number_are_refused(self, campaign, names):
        with pytest.raises(MeasurementError, match=f"7 {names}"):
            replace(campaign[1], **{names: tuple("abcdefg")})


class TestWrist:
    def test_centre_is_where_the_axes_meet(self, campaign):
        wrist = find_wrist(campaign[0])
        assert wrist.miss_distance < 1e-12
        q = np.random.default_rng(1).uniform(-2, 2, (20, 6))
        now = Configurations(campaign[0], q)
        centre = now.to_base(np.broadcast_to(wrist.centre, (20, 1, 3)))
        np.testing.assert_allclose(now.jacobian_at(centre)[..., 3:], 0.0, atol=1e-12)

    @pytest.mark.parametrize("offset", [0.0, 0.2e-3, 0.03])
    def test_miss_distance_of_an_offset_wrist(self, offset):
        wrist = find_wrist(robot_of(default_arm(wrist_offset=offset)))
        # The nearest point halves the offset, or does a little worse for a third axis.
        assert offset / 3 <= wrist.miss_distance <= offset + 1e-12
        assert wrist.spherical == (wrist.miss_distance <= 0.5e-3)

    def test_real_robot(self):
        robot, _ = prepare(shared("fanuc_r2000ic/campaign"))
        assert find_wrist(robot).miss_distance < 1e-12


class TestIdentifiability:
    def test_groups_that_do_not_mix_are_told_apart(self):
        rng = np.random.default_rng(0)
        base = rng.standard_normal((20, 4))
        R = np.column_stack(
            [base[:, 0], 2 * base[:, 0], base[:, 1], base[:, 2], base[:, 2] * 1e-5, base[:, 3]]
        )
        found = analyse(Spectrum(R), np.array([0, 1, 2, 4, 5, 6]), 7)
        assert [group.joints for group in found.combinations] == [(0, 1), (4, 5)]
        assert found.rank == 4
        assert found.condition_number == np.inf
        assert found.combined == {0, 1, 4, 5}

    def test_units_of_the_columns_do_not_matter(self):
        rng = np.random.default_rng(1)
        R = rng.standard_normal((9, 5))
        plain = analyse(Spectrum(R), np.arange(5), 5)
        scaled = analyse(Spectrum(R * 10.0 ** np.arange(-6, 4, 2)), np.arange(5), 5)
        assert scaled.rank == 5
        assert scaled.condition_number == pytest.approx(plain.condition_number)
        singular = np.linalg.svd(R / np.linalg.norm(R, axis=0), compute_uv=False)
        np.testing.assert_allclose(plain.singular_values, singular)


def test_errors_say_where_why_and_what_to_do_even_in_another_process():
    sent = UnsupportedMethodError("too few targets", where="readings", remedy="read three")
    assert isinstance(sent, JointstiffError)
    received = pickle.loads(pickle.dumps(sent))
    assert type(received) is UnsupportedMethodError
    for error in (sent, received):
        assert str(error) == "readings: too few targets; read three"
        assert (error.reason, error.where, error.remedy) == ("too few targets", "readings", "read three")


def _cross_matrix(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
