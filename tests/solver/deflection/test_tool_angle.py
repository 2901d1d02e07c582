"""Dynamic programming beside all paths counted out."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from jointstiff.solver.deflection.paths import PathNodes, best_constant_angle, best_path
from jointstiff.solver.errors import RequestError


def random_nodes(seed, steps=5, angles=3, branches=2, turn=0.6):
    generator = np.random.default_rng(seed)
    joints = generator.uniform(-1, 1, (steps, angles, branches, 2))
    joints[generator.random((steps, angles, branches)) < 0.2] = np.nan
    cost = generator.uniform(0, 1, (steps, angles, branches))
    cost[generator.random(cost.shape) < 0.1] = np.inf
    return PathNodes(joints, cost, np.full(2, turn))


def is_path(nodes, path):
    at = np.array([nodes.joints[s, a, b] for s, (a, b) in enumerate(path)])
    cost = np.array([nodes.cost[s, a, b] for s, (a, b) in enumerate(path)])
    steps = np.abs(np.diff(at, axis=0)) <= nodes.largest_turn
    return bool(np.isfinite(at).all() and np.isfinite(cost).all() and steps.all()), cost.sum()


def counted_out(nodes, *, constant=False):
    """The least sum over all paths; None if there is none."""
    _, angles, branches = nodes.cost.shape
    every = product(product(range(angles), range(branches)), repeat=len(nodes.cost))
    sums = [
        total
        for path in every
        if not (constant and len({a for a, _ in path}) > 1)
        for there, total in [is_path(nodes, path)]
        if there
    ]
    return min(sums, default=None)


@pytest.mark.parametrize("seed", range(12))
def test_no_path_is_better(seed):
    nodes = random_nodes(seed, steps=4)
    least = counted_out(nodes)
    if least is None:
        with pytest.raises(RequestError, match="reached"):
            best_path(nodes)
        return
    path = best_path(nodes)
    there, total = is_path(nodes, list(zip(path.angle, path.branch, strict=True)))
    assert there
    assert total == pytest.approx(least, rel=1e-12)
    assert path.mean == pytest.approx(least / 4, rel=1e-12)
    assert path.lower_bound <= path.mean


@pytest.mark.parametrize("seed", range(12))
def test_no_constant_angle_is_better(seed):
    nodes = random_nodes(seed, steps=4, turn=1.2)
    least = counted_out(nodes, constant=True)
    found = best_constant_angle(nodes)
    assert (found is None) == (least is None)
    if found is not None:
        assert len(set(found.angle)) == 1
        assert found.mean == pytest.approx(least / 4, rel=1e-12)
        assert best_path(nodes).mean <= found.mean


def test_joints_that_may_turn_freely_reach_the_bound():
    nodes = random_nodes(3, steps=30, turn=10.0)
    path = best_path(nodes)
    assert path.mean == pytest.approx(path.lower_bound, rel=1e-12)


def test_a_gap_is_named():
    nodes = random_nodes(0, steps=6)
    cost = nodes.cost.copy()
    cost[4] = np.inf
    with pytest.raises(RequestError) as caught:
        best_path(PathNodes(nodes.joints, cost, np.full(2, 10.0)))
    assert caught.value.where == "path[4]"


@pytest.mark.parametrize("wrong", ["shape", "nan", "limit"])
def test_what_is_no_grid_is_refused(wrong):
    nodes = random_nodes(0)
    cost = nodes.cost[:, :2] if wrong == "shape" else np.where(wrong == "nan", np.nan, nodes.cost)
    with pytest.raises(RequestError):
        PathNodes(nodes.joints, cost, np.full(2, 0.0 if wrong == "limit" else 1.0))
