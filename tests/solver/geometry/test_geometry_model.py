"""The identified model: chain, URDF, DH tables, link table, flange."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.examples import examples
from support.geometry_truth import (
    FANUC_MAP,
    HOME,
    TARGETS,
    Cell,
    axes_of_noisy_sweeps,
    chi_square,
    imperfect_arm,
    nominal,
)

from jointstiff.simulator import default_arm
from jointstiff.simulator.arm import SpringArm
from jointstiff.simulator.urdf import urdf_text
from jointstiff.solver.errors import MeasurementError, RobotError
from jointstiff.solver.geometry.charts import RigidTransform
from jointstiff.solver.geometry.frames import BaseFrame, find_base_frame
from jointstiff.solver.geometry.model import (
    DhTable,
    FlangeConvention,
    IdentifiedModel,
    dh_table,
    identify_model,
    link_table,
)
from jointstiff.solver.geometry.poses import IdentifiedAxes, chain_axes
from jointstiff.solver.geometry.sweeps import identify_axes
from jointstiff.solver.robot.chain import KinematicChain, dh_chain
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import JointMap, Robot
from jointstiff.solver.robot.urdf import read_urdf, write_urdf

ANGLES = np.random.default_rng(6).uniform(-np.pi, np.pi, (40, 6))


def model_of(found: IdentifiedAxes) -> tuple[BaseFrame, IdentifiedModel]:
    base = find_base_frame(found, nominal())
    return base, identify_model(found, base, FlangeConvention.of_chain(nominal()), nominal=nominal())


def flange_points(chain: KinematicChain, angles: np.ndarray, points: np.ndarray) -> np.ndarray:
    configurations = Configurations(Robot(chain), angles)
    turned = np.einsum("nij,tj->nti", configurations.flange_rotation, points)
    return turned + configurations.flange_translation[:, None]


def exact_table(chain: KinematicChain, convention: str) -> DhTable:
    return dh_table(chain, convention, parallel_within=0.0)  # type: ignore[arg-type]


def table_gap(table: DhTable, chain: KinematicChain, points: np.ndarray = TARGETS) -> np.ndarray:
    """How far off the chain's the table's points on the flange are, in all postures [m]."""
    moved = flange_points(dh_chain(table.rows, table.convention, "x"), ANGLES, table.tool.apply(points))
    return table.base.apply(moved) - flange_points(chain, ANGLES, points)


@pytest.mark.parametrize("matrix", [np.eye(6), FANUC_MAP], ids=["own", "coupled"])
def test_the_model_predicts_what_the_tracker_reads_anywhere(matrix: np.ndarray) -> None:
    cell = Cell(imperfect_arm(11), matrix=matrix)
    base, model = model_of(identify_axes(cell.sweeps()))
    robot = Robot(model.chain, JointMap(matrix, np.zeros(6)))
    angles = robot.joint_map.model_angles(ANGLES)
    predicted = flange_points(model.chain, angles, model.targets_in_flange)
    read = base.transform_tracker_to_base.apply(cell.readings(ANGLES))
    assert np.abs(predicted - read).max() < 1e-7
    assert model.chain.joint_names == nominal().joint_names
    assert model.chain.revolute[2].limits == nominal().revolute[2].limits


def test_urdf_is_read_back_to_the_same_kinematics() -> None:
    _, model = model_of(axes_of_noisy_sweeps(3))
    again = read_urdf(write_urdf(model.chain), model.chain.base, model.chain.flange)
    gap = flange_points(again, ANGLES, TARGETS) - flange_points(model.chain, ANGLES, TARGETS)
    assert np.abs(gap).max() < 1e-9


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("seed", range(4))
def test_dh_tables_are_exact_where_no_axes_are_nearly_parallel(seed: int, convention: str) -> None:
    rng = np.random.default_rng(seed)
    arm = imperfect_arm(seed)
    directions = arm.axis_directions + rng.normal(0.0, 0.3, (6, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    chain = read_urdf(urdf_text(replace(arm, axis_directions=directions)), "base_link", "flange")
    table = exact_table(chain, convention)
    assert all(abs(row.d) < 100.0 for row in table.rows)
    assert np.abs(table_gap(table, chain)).max() < 1e-9
    assert table.deviation < 1e-12


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_dh_of_exactly_parallel_axes_is_exact_and_tidy(convention: str) -> None:
    table = exact_table(nominal(), convention)
    assert np.abs(table_gap(table, nominal())).max() < 1e-12
    lengths = sorted(
        round(abs(value), 9) for row in table.rows for value in (row.a, row.d) if abs(value) > 1e-9
    )
    assert lengths == [0.06, 0.24, 0.33, 0.78, 1.12, 1.31]
    assert [pair.joint for pair in table.parallel] == ["joint_2"]
    assert table.base.rotation == pytest.approx(np.eye(3))


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("shift", [-0.4, 0.7])
def test_parallel_axes_beside_the_plane_of_the_base_have_the_same_links(
    convention: str, shift: float
) -> None:
    """Axis 1 moved along the parallel pair: an offset d takes the shift up, all lengths a stay."""
    arm = default_arm()
    moved = arm.axis_points + np.outer(np.arange(6) == 0, [0.0, shift, 0.0])
    shifted = replace(arm, axis_points=moved)
    chain = read_urdf(urdf_text(shifted), "base_link", "flange")
    tables = [exact_table(each, convention) for each in (nominal(), chain)]
    assert np.abs(table_gap(tables[1], chain)).max() < 1e-12
    lengths = [sorted(round(abs(row.a), 9) for row in table.rows[1:4]) for table in tables]
    assert lengths[0] == lengths[1]


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_dh_of_nearly_parallel_axes_says_what_it_leaves_out(convention: str) -> None:
    _, model = model_of(axes_of_noisy_sweeps(1))
    table = dh_table(model.chain, convention)  # type: ignore[arg-type]
    (pair,) = table.parallel
    assert (pair.joint, pair.made_parallel) == ("joint_2", True)
    assert 1e-6 < pair.angle < 2e-4
    measured = np.linalg.norm(table_gap(table, model.chain, np.zeros((1, 3))), axis=-1).max()
    assert 0.3 * table.deviation < measured < 1.2 * table.deviation
    assert 1e-6 < table.deviation < 1e-3
    exact = exact_table(model.chain, convention)
    assert not exact.parallel[0].made_parallel
    assert max(abs(row.d) for row in exact.rows) > 100.0


class TestLinkTable:
    def table(self, arm: SpringArm) -> dict[tuple[str, str], tuple[float, float]]:
        return self.table_of(identify_axes(Cell(arm).sweeps()))

    def table_of(self, found: IdentifiedAxes) -> dict[tuple[str, str], tuple[float, float]]:
        base = find_base_frame(found, nominal())
        rows = link_table(found, base, FlangeConvention.of_chain(nominal()), nominal())
        return {(row.quantity, row.joint): (row.difference, row.standard_uncertainty) for row in rows}

    def test_it_shows_what_was_changed_and_nothing_else(self) -> None:
        arm = default_arm()
        points = arm.axis_points.copy()
        points[2:, 2] += 1e-3  # upper arm
        points[4:, 0] += 2e-3  # forearm
        rows = self.table(replace(arm, axis_points=points))
        assert rows["a", "joint_2"][0] == pytest.approx(1e-3, abs=1e-8)
        assert rows["d", "joint_4"][0] == pytest.approx(-2e-3, abs=1e-8)  # axis 4 points backwards
        others = [gap for key, (gap, _) in rows.items() if key not in {("a", "joint_2"), ("d", "joint_4")}]
        assert np.abs(others).max() < 1e-7

    def test_joint_offsets_show_as_theta(self) -> None:
        arm = default_arm()
        turn = 1e-3
        cosine, sine = np.cos(turn), np.sin(turn)
        about_y = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
        points, directions = arm.axis_points.copy(), arm.axis_directions.copy()
        points[3:] = points[2] + (points[3:] - points[2]) @ about_y.T
        directions[3:] = directions[3:] @ about_y.T
        rows = self.table(replace(arm, axis_points=points, axis_directions=directions))
        assert rows["theta", "joint_3"][0] == pytest.approx(turn, abs=1e-7)
        assert max(abs(gap) for key, (gap, _) in rows.items() if key != ("theta", "joint_3")) < 1e-7

    def test_its_uncertainties_are_true(self) -> None:
        exact = self.table(default_arm())
        squares = []
        for seed in range(25):
            rows = self.table_of(axes_of_noisy_sweeps(seed))
            squares.append([((rows[key][0] - exact[key][0]) / rows[key][1]) ** 2 for key in exact])
        assert np.mean(squares, axis=0) == pytest.approx(np.ones(len(exact)), abs=1.1)
        assert np.mean(squares) == pytest.approx(1.0, abs=0.25)


class TestFlange:
    def test_targets_state_their_uncertainty(self) -> None:
        squares = []
        for seed in range(25):
            _, model = model_of(axes_of_noisy_sweeps(seed))
            error = (model.targets_in_flange - TARGETS).ravel()
            squares.append(chi_square(error, model.targets_covariance))
        assert np.mean(squares) == pytest.approx(9.0, rel=0.35)

    def test_by_targets(self) -> None:
        cell = Cell(imperfect_arm(2))
        found = identify_axes(cell.sweeps())
        base = find_base_frame(found)
        model = identify_model(found, base, FlangeConvention((0, 1, 2)))
        first, second, third = model.targets_in_flange
        assert np.abs(first).max() < 1e-12
        assert second[1:] == pytest.approx([0.0, 0.0], abs=1e-12)
        assert third[2] == pytest.approx(0.0, abs=1e-12)
        assert third[1] > 0.0
        read = base.transform_tracker_to_base.apply(cell.readings(HOME[None]))
        assert flange_points(model.chain, HOME[None], model.targets_in_flange) == pytest.approx(
            read, abs=1e-7
        )

    def test_by_axes_the_origin_is_the_wrist_centre(self) -> None:
        found = identify_axes(Cell().sweeps())
        base = find_base_frame(found, nominal())
        model = identify_model(found, base, FlangeConvention())
        _, flange = chain_axes(model.chain)
        assert flange.translation == pytest.approx(default_arm().axis_points[4], abs=1e-8)

    def test_targets_on_a_line_are_refused(self) -> None:
        line = np.outer([1.0, 2.0, 3.0], [0.0, 0.1, 0.0])
        with pytest.raises(MeasurementError, match="line"):
            FlangeConvention((0, 1, 2)).place((), line)

    def test_a_nominal_model_of_another_robot_is_refused(self) -> None:
        found, chain = axes_of_noisy_sweeps(0), nominal()
        short = KinematicChain("short", chain.base, chain.joints[4].child, chain.joints[:5])
        with pytest.raises(RobotError, match="5 revolute joints"):
            identify_model(found, find_base_frame(found), FlangeConvention(), nominal=short)


@examples(20)
@given(st.integers(0, 10_000))
def test_rigid_transforms_undo_and_follow_each_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    found = any_transform(rng)
    point = rng.normal(size=3)
    assert found.inverse().apply(found.apply(point)) == pytest.approx(point, abs=1e-12)
    back_and_forth = found.inverse().inverse()
    assert back_and_forth.covariance == pytest.approx(found.covariance, abs=1e-12)
    step = 1e-6 * rng.normal(size=6)
    moved = found.displaced(step)
    assert found.chart(moved) == pytest.approx(step, abs=1e-12)
    assert moved.apply(point) - found.apply(point) == pytest.approx(
        found.sensitivity(found.apply(point)) @ step, abs=1e-10
    )


def any_transform(rng: np.random.Generator) -> RigidTransform:
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    factor = rng.normal(size=(6, 6))
    return RigidTransform(rotation * np.linalg.det(rotation), rng.normal(size=3), factor @ factor.T)
