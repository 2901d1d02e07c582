"""Two campaigns beside each other, against truth, exact springs, and a solver that shares no code."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import nnls
from support.campaigns import METHODS, prepare, settings_of
from support.encoders import with_encoders
from support.shared_data import shared

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.arm import SpringArm
from jointstiff.simulator.campaign import TARGETS, deflections, linear_deflections
from jointstiff.simulator.document import experiment_of
from jointstiff.solver.errors import RequestError, UnsupportedMethodError
from jointstiff.solver.fitting.settings import Prior
from jointstiff.solver.paired.avoided import measured_share
from jointstiff.solver.paired.comparison import compare_pair
from jointstiff.solver.paired.sides import PairSide, match, models_differ
from jointstiff.solver.readings.measurements import CommonUncertainty

MOTOR, SECONDARY = default_arm("motor"), default_arm("secondary")
T95 = 1.959963984540054
ACROSS = {"method": "decoupled_partial_pose", "stiffness_order": [["joint_6", "joint_2"]]}


def side(document, **options):
    robot, measurements = prepare(document)
    return PairSide(robot, measurements, settings_of(robot, **options))


def simulated(method="partial_pose", **options):
    """Motor and secondary encoders, the same postures, independent noise."""
    wanted = {"load": "pull", "readings": "deflections", **options}
    first = simulate_campaign(MOTOR, **{"seed": 5, **wanted})
    second = simulate_campaign(SECONDARY, **{"seed": 5, **wanted})
    rng = np.random.default_rng(11)
    for observation in second["measurement_set"]["observations"]:
        for reading in observation["readings"]:
            reading["deflection"] = (np.array(reading["deflection"]) + rng.normal(0, 2e-5, 3)).tolist()
    return side(first, method=method), side(second, method=method)


def pair_of(first, second, *, ordered=False, confidence=0.95):
    return compare_pair(first, second, confidence=confidence, ordered=ordered)


@pytest.fixture(scope="module", params=METHODS)
def dead_weight(request):
    names = ("simulated/dead_weight_motor", "simulated/dead_weight_secondary")
    return pair_of(*(side(shared(name), method=request.param) for name in names), ordered=True)


def test_ratios_are_those_of_the_truth(dead_weight):
    truth = shared("simulated/truth")
    stiffness = [np.array(truth[f"dead_weight_{name}"]["stiffness"]) for name in ("motor", "secondary")]
    expected = stiffness[1] / stiffness[0]
    assert dead_weight.joints[0].ratio is None
    assert "never twists joint_1" in dead_weight.joints[0].reason
    for joint, ratio in zip(dead_weight.joints[1:], expected[1:], strict=True):
        uncertainty = (joint.interval.upper - joint.interval.lower) / (2 * T95)
        assert abs(joint.ratio - ratio) < 4 * uncertainty, joint.name
        assert uncertainty < 0.1 * ratio


def test_what_has_changed_is_told_from_what_has_not(dead_weight):
    """Joint 4 differs by 10 % in truth, which these readings cannot tell; the others can."""
    p_values = [joint.p_value for joint in dead_weight.joints[1:]]
    assert all(p < 1e-3 for p in (*p_values[:2], *p_values[3:]))
    assert p_values[2] > 0.01


def _shared_arm(document, stiffness):
    """The shared robot as springs: axes from truth.json, the flange by the sum of the URDF's offsets."""
    axes = shared("simulated/truth")["sweeps"]["axes_at_zero"]
    offsets = re.findall(r'origin xyz="([^"]+)" rpy="([^"]+)"', document["robot"]["model"]["urdf"])
    assert all(np.array(rpy.split(), float).any() == 0 for _, rpy in offsets)
    return SpringArm(
        axis_points=np.array([axis["point"] for axis in axes]),
        axis_directions=np.array([axis["direction"] for axis in axes]),
        flange_rotation=np.eye(3),
        flange_translation=np.sum([np.array(xyz.split(), float) for xyz, _ in offsets], axis=0),
        stiffnesses=np.array(stiffness),
    )


def test_share_of_deflection_avoided_is_the_simulated_one(dead_weight):
    document, truth = shared("simulated/dead_weight_motor"), shared("simulated/truth")
    document["measurement_set"]["units"].setdefault("moment", "N.m")
    experiment = experiment_of(document)
    lengths = []
    for name in ("motor", "secondary"):
        arm = _shared_arm(document, truth[f"dead_weight_{name}"]["stiffness"])
        posture = arm.posture(experiment.joints)
        read = np.array(
            [[r["unloaded"] for r in o["readings"]] for o in document["measurement_set"]["observations"]]
        )
        local = (read - posture.flange_translation[:, None]) @ posture.flange_rotation
        assert np.ptp(local, axis=0).max() < 2e-4  # the targets sit still on this flange
        unloaded, loaded = deflections(arm, experiment.joints, *experiment.wrenches, local.mean(axis=0))
        lengths.append(np.linalg.norm(loaded - unloaded, axis=2))
    simulated_share = 1 - lengths[1].mean() / lengths[0].mean()
    avoided = dead_weight.avoided
    assert abs(avoided.measured.overall.value - simulated_share) < 0.01 * simulated_share
    assert abs(avoided.predicted.value - simulated_share) < 0.01 * simulated_share
    each = 1 - lengths[1].mean(axis=1) / lengths[0].mean(axis=1)
    for share, exact in zip(avoided.measured.each, each, strict=True):
        assert abs(share.value - exact) < 5 * share.standard_uncertainty + 0.002  # of the noise's own length


def test_the_order_is_never_crossed(dead_weight):
    """In truth joint 6 is softer on the second side: the order holds both equal there."""
    ordered = dead_weight.ordered
    seen = np.isfinite(ordered.first)
    assert (ordered.second[seen] <= ordered.first[seen]).all()
    assert ordered.equal.tolist() == [False, False, False, False, False, True]
    assert ordered.chi_square_increase > 5
    assert all(certificate.is_optimal() for certificate in ordered.certificates)
    assert not seen[0]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", range(5))
def test_the_order_is_never_crossed_in_noise(method, seed):
    """The same arm twice: about half of the joints would cross."""
    first, second = (
        side(simulate_campaign(MOTOR, load="pull", configurations=8, sigma=3e-4, seed=s), method=method)
        for s in (seed, seed + 100)
    )
    pair = pair_of(first, second, ordered=True)
    assert (pair.ordered.second <= pair.ordered.first).all()
    assert pair.ordered.equal.any()
    low, high = pair.ordered_intervals[..., 0], pair.ordered_intervals[..., 1]
    inside = np.stack([pair.ordered.first, pair.ordered.second])
    assert (low >= 0).all()
    assert ((low <= inside * (1 + 1e-9)) & (inside <= high * (1 + 1e-9))).all()
    assert (low[1] <= low[0] * (1 + 1e-9) + 1e-30).all()
    assert (high[1] <= high[0] * (1 + 1e-9)).all()


@pytest.mark.parametrize(
    "options", [{"method": "decoupled_partial_pose"}, {"method": "complete_pose", "weighting": "uniform"}]
)
def test_ordered_intervals_contain_estimates_that_are_not_of_maximum_likelihood(options):
    """A bound that the readings contradict draws the least squares of such a method elsewhere."""
    stated = {"stiffness_bounds": {"joint_3": [1e5, 5e5]}, **options}
    first, second = (
        side(simulate_campaign(arm, configurations=4, load="pull"), **stated) for arm in (MOTOR, SECONDARY)
    )
    pair = pair_of(first, second, ordered=True)
    inside = np.stack([pair.ordered.first, pair.ordered.second])
    assert (pair.ordered_intervals[..., 0] <= inside).all()
    assert (inside <= pair.ordered_intervals[..., 1]).all()


@pytest.mark.parametrize(
    ("first", "second", "reason"),
    [
        (
            {"stiffness_bounds": {"joint_2": [4e6, None]}},
            {"stiffness_bounds": {"joint_2": [None, 3e6]}},
            "bounds contradict",
        ),
        (ACROSS, ACROSS, "arm and wrist"),
    ],
)
def test_what_both_in_one_problem_cannot_hold_is_refused(first, second, reason):
    document = simulate_campaign(MOTOR, load="pull", seed=1)
    with pytest.raises(RequestError, match=reason):
        pair_of(side(document, **first), side(document, **second), ordered=True)


def _whitened(arm, document, sigma):
    """A (9N, 6) and d of a campaign with deflections, by unit compliances of a simulator of ours."""
    experiment = experiment_of(document)
    points = np.array(list(TARGETS.values()))
    columns = []
    for j in range(6):
        unit = replace(arm, stiffnesses=np.where(np.arange(6) == j, 1e6, np.inf))
        exact = linear_deflections(unit, experiment.joints, *experiment.wrenches, points)
        columns.append(1e6 * exact.ravel())
    read = [[r["deflection"] for r in o["readings"]] for o in document["measurement_set"]["observations"]]
    return np.stack(columns, 1) / (np.sqrt(2) * sigma), np.ravel(read) / (np.sqrt(2) * sigma)


@pytest.fixture(scope="module")
def crossing():
    """Two campaigns with the same arm and different noise, stated sigmas; and their rows."""
    documents = [
        simulate_campaign(MOTOR, load="pull", readings="deflections", configurations=9, sigma=s, seed=seed)
        for s, seed in ((2e-4, 1), (4e-4, 2))
    ]
    pair = pair_of(*(side(document) for document in documents), ordered=True)
    (A, a), (B, b) = (
        _whitened(MOTOR, document, sigma) for document, sigma in zip(documents, (2e-4, 4e-4), strict=True)
    )
    M = np.block([[A, A], [B, np.zeros_like(B)]])
    return pair, M, np.concatenate([a, b]), (A, a), (B, b)


def _nnls(M, d):
    norms = np.linalg.norm(M, axis=0)
    x, norm = nnls(M / norms, d, maxiter=1000)
    return x / norms, norm**2


def test_the_ordered_optimum_is_that_of_an_independent_solver(crossing):
    pair, M, d, one, two = crossing
    v, squares = _nnls(M, d)
    np.testing.assert_allclose(pair.ordered.second, v[:6], rtol=1e-8, atol=1e-15)
    np.testing.assert_allclose(pair.ordered.first, v[:6] + v[6:], rtol=1e-8)
    assert pair.ordered.equal.tolist() == (v[6:] == 0).tolist()
    alone = _nnls(*one)[1] + _nnls(*two)[1]
    assert pair.ordered.chi_square_increase == pytest.approx(squares - alone, rel=1e-6)


@pytest.mark.parametrize("j", range(6))
def test_ordered_intervals_end_where_the_likelihood_has_fallen_by_its_quantile(crossing, j):
    pair, M, d, *_ = crossing
    least = _nnls(M, d)[1]
    others = np.delete(np.arange(12), j)
    for end in pair.ordered_intervals[1, j]:
        if end == 0.0:
            continue
        at_end = _nnls(M[:, others], d - M[:, j] * end)[1]
        assert at_end - least == pytest.approx(T95**2, rel=1e-6)


def test_both_ends_of_a_campaign_with_itself():
    document = simulate_campaign(MOTOR, load="pull", seed=2)
    pair = pair_of(side(document), side(document), ordered=True)
    assert [joint.p_value for joint in pair.joints] == [1.0] * 6
    assert [joint.ratio for joint in pair.joints] == [1.0] * 6
    assert pair.avoided.measured.overall.value == 0.0
    assert pair.avoided.predicted.value == pytest.approx(0.0, abs=1e-12)
    assert pair.ordered.chi_square_increase == pytest.approx(0.0, abs=1e-6)


def test_swapping_the_campaigns_inverts_the_ratios():
    first, second = simulated()
    there, back = pair_of(first, second), pair_of(second, first)
    for one, two in pairwise([there.joints, back.joints]):
        for a, b in zip(one, two, strict=True):
            assert a.ratio == pytest.approx(1 / b.ratio)
            assert a.interval.lower == pytest.approx(1 / b.interval.upper)
            assert a.p_value == pytest.approx(b.p_value)


def test_sigma_from_the_residuals_takes_the_fewer_degrees_of_freedom():
    first, second = simulated()
    estimated = [replace(s, measurements=replace(s.measurements, sigma=None)) for s in (first, second)]
    given, shown = pair_of(first, second), pair_of(*estimated)
    freedom = min(e.degrees_of_freedom for e in (shown.first, shown.second))
    assert freedom == 9 * 19 - 6
    for joint in shown.joints:
        assert joint.interval.lower < joint.ratio < joint.interval.upper
    assert [j.ratio for j in shown.joints] == pytest.approx([j.ratio for j in given.joints])


def test_uncertainty_of_the_measured_share_is_what_noise_does():
    first, second = simulated(configurations=6, readings="deflections")
    matches = match(first, second)
    sigma, spread, rng = 2e-5, np.sqrt(2) * 2e-5, np.random.default_rng(3)
    exact = [s.measurements.deflection for s in (first, second)]
    overall, each = [], []
    for _ in range(1500):
        noisy = [
            replace(s, measurements=replace(s.measurements, deflection=d + rng.normal(0, spread, d.shape)))
            for s, d in zip((first, second), exact, strict=True)
        ]
        share = measured_share(*noisy, matches, (sigma, sigma))
        overall.append(share.overall.value)
        each.append(share.each[0].value)
    stated = measured_share(first, second, matches, (sigma, sigma))
    tolerance = 4.5 / np.sqrt(2 * 1500)
    assert np.std(overall) == pytest.approx(stated.overall.standard_uncertainty, rel=tolerance)
    assert np.std(each) == pytest.approx(stated.each[0].standard_uncertainty, rel=tolerance)


def test_other_postures_and_loads_do_not_match():
    first, second = simulated()
    m = second.measurements
    joints, force, point = m.joints.copy(), m.force.copy(), m.load_point.copy()
    joints[0, 2] += 2e-3
    force[1] *= 1.01
    point[2, 0] += 2e-3
    joints[3, 2] += 1e-4
    moved = replace(second, measurements=replace(m, joints=joints, force=force, load_point=point))
    matches = match(first, moved)
    assert matches.unlike == ("c01", "c02", "c03")
    assert matches.first.tolist() == list(range(3, 19))
    pair = pair_of(first, moved)
    assert len(pair.avoided.measured.each) == 16
    assert len(pair.avoided.of_second.first) == 19


def test_labels_find_each_other_in_any_order():
    first, second = simulated()
    order = np.random.default_rng(1).permutation(19)
    shuffled = replace(second, measurements=second.measurements[order])
    straight, crossed = pair_of(first, second), pair_of(first, shuffled)
    assert crossed.avoided.measured.overall.value == pytest.approx(straight.avoided.measured.overall.value)
    assert crossed.avoided.predicted.value == pytest.approx(straight.avoided.predicted.value)


def test_no_common_observation_leaves_the_prediction():
    first, second = simulated()
    labels = tuple(f"x{label}" for label in second.measurements.labels)
    renamed = replace(second, measurements=replace(second.measurements, labels=labels))
    avoided = pair_of(first, renamed).avoided
    assert avoided.measured is None
    assert 0.2 < avoided.predicted.value < 0.6


def test_a_joint_that_one_campaign_does_not_twist():
    first = side(simulate_campaign(MOTOR, load="pull", seed=5))
    second = side(simulate_campaign(SECONDARY, load="dead_weight", seed=5))
    pair = pair_of(first, second, ordered=True)
    joint = pair.joints[0]
    assert (joint.ratio, joint.interval, joint.p_value) == (None, None, None)
    assert joint.reason.startswith("in the second set: the load never twists joint_1")
    assert np.isfinite(pair.ordered.first).all()
    assert np.isnan(pair.ordered.second).tolist() == [True, False, False, False, False, False]
    assert np.isnan(pair.ordered_intervals[1, 0]).all()
    assert pair.ordered.first[0] == pytest.approx(MOTOR.compliances[0], rel=0.1)
    assert np.isnan(pair.avoided.of_first.first).all()  # every pull twists joint 1
    assert np.isfinite(pair.avoided.of_second.first).all()


def test_a_joint_that_only_the_second_campaign_twists():
    first = side(simulate_campaign(MOTOR, load="dead_weight", seed=5))
    second = side(simulate_campaign(SECONDARY, load="pull", seed=5))
    ordered = pair_of(first, second, ordered=True).ordered
    assert np.isnan(ordered.first[0])
    assert ordered.second[0] == pytest.approx(SECONDARY.compliances[0], rel=0.1)


def test_stiffness_bounds_hold_on_both_sides():
    first, second = simulated()
    stiffest = 3.0e6  # joint 2 is at 3.1e6 with the motors' encoders, at 5.7e6 with secondary ones
    tight = [
        replace(s, settings=settings_of(s.robot, stiffness_bounds={"joint_2": (4e6, 5e6)}))
        for s in (first, second)
    ]
    ordered = pair_of(*tight, ordered=True).ordered
    assert ordered.first[1] == pytest.approx(1 / 4e6)
    assert ordered.second[1] == pytest.approx(1 / 5e6)
    loose = [replace(s, settings=settings_of(s.robot)) for s in (first, second)]
    assert 1 / pair_of(*loose, ordered=True).ordered.first[1] == pytest.approx(stiffest, rel=0.1)


def test_an_order_of_the_joints_holds_within_each_side():
    first, second = simulated()
    chain = [["joint_3", "joint_2"]]
    sides = [replace(s, settings=settings_of(s.robot, stiffness_order=chain)) for s in (first, second)]
    pair = pair_of(*sides, ordered=True)
    for c in (pair.ordered.first, pair.ordered.second):
        assert c[2] <= c[1] * (1 + 1e-12)
    assert (pair.ordered.second <= pair.ordered.first).all()


def test_a_rigid_second_side_has_no_upper_limit():
    stiff = replace(SECONDARY, stiffnesses=np.where(np.arange(6) == 1, np.inf, SECONDARY.stiffnesses))
    second = side(simulate_campaign(stiff, load="pull", seed=9, configurations=8, sigma=1e-4))
    first = side(simulate_campaign(MOTOR, load="pull", seed=5, configurations=8, sigma=1e-4))
    joint = pair_of(first, second).joints[1]
    assert joint.interval.upper is None
    assert joint.interval.lower > 3
    assert joint.p_value < 1e-3


@pytest.mark.parametrize(
    ("change", "where", "reason"),
    [
        ({"prior": Prior(np.full(6, 1e-7), np.full(6, 1e-8))}, "priors", "independent"),
        ({"loss": "huber"}, "ordered", "huber"),
    ],
)
def test_what_does_not_go_together_is_refused(change, where, reason):
    first, second = simulated()
    sides = [replace(s, settings=replace(s.settings, **change)) for s in (first, second)]
    with pytest.raises(RequestError, match=reason) as refusal:
        pair_of(*sides, ordered=True)
    assert refusal.value.where == where


def test_one_problem_takes_one_method():
    first, second = simulated()
    other = replace(second, settings=replace(second.settings, method="complete_pose"))
    with pytest.raises(UnsupportedMethodError, match="one method"):
        pair_of(first, other, ordered=True)
    assert pair_of(first, other).joints[1].ratio == pytest.approx(5.7 / 3.1, rel=0.1)


def test_complementary_stiffness_and_huber():
    first, second = simulated()
    plain = pair_of(first, second)
    for change in ({"complementary_stiffness": True}, {"loss": "huber"}):
        sides = [replace(s, settings=replace(s.settings, **change)) for s in (first, second)]
        pair = pair_of(*sides)
        for joint, same in zip(pair.joints, plain.joints, strict=True):
            assert joint.ratio == pytest.approx(same.ratio, rel=0.1)


def test_the_order_holds_with_the_complementary_stiffness():
    """Readings without noise: the order's one problem finds the springs, which without K_c are 1e-3 off."""
    free = replace(MOTOR, stiffnesses=0.9 * SECONDARY.stiffnesses)
    exact = [side(simulate_campaign(arm, load="pull", seed=5, sigma=0.0)) for arm in (free, SECONDARY)]
    sides = [replace(s, measurements=replace(s.measurements, sigma=2e-5)) for s in exact]
    included, neglected = (
        pair_of(
            *(replace(s, settings=replace(s.settings, complementary_stiffness=with_it)) for s in sides),
            ordered=True,
        ).ordered
        for with_it in (True, False)
    )
    np.testing.assert_allclose(included.first, free.compliances, rtol=1e-4)
    np.testing.assert_allclose(included.second, SECONDARY.compliances, rtol=1e-4)
    assert np.abs(neglected.first / free.compliances - 1).max() > 1e-3


def test_robots_whose_joints_do_not_correspond_are_refused():
    first, second = simulated()
    chain = first.robot
    renamed = replace(second, robot=_renamed(chain))
    with pytest.raises(RequestError, match="have different joints"):
        pair_of(first, renamed)


def _renamed(robot):
    document = simulate_campaign(MOTOR, configurations=1)
    document["robot"]["model"]["urdf"] = document["robot"]["model"]["urdf"].replace("joint_3", "elbow")
    return prepare(document)[0]


def test_models_that_differ_are_noticed():
    robot = simulated()[0].robot
    assert not models_differ(robot, simulated()[1].robot)
    other = side(simulate_campaign(default_arm(wrist_offset=0.01), configurations=2)).robot
    assert models_differ(robot, other)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_ratio_intervals_cover(method):
    """300 pairs of campaigns of exact springs, small load: the intervals cover as often as they say."""
    covered = np.zeros(6)
    expected = SECONDARY.stiffnesses / MOTOR.stiffnesses
    count = 300
    for k in range(count):
        sides = [
            side(simulate_campaign(arm, load="pull", force=300.0, seed=2 * k + i), method=method)
            for i, arm in enumerate((MOTOR, SECONDARY))
        ]
        for j, joint in enumerate(pair_of(*sides, confidence=0.9).joints):
            if joint.interval is None:
                continue
            upper = np.inf if joint.interval.upper is None else joint.interval.upper
            covered[j] += joint.interval.lower <= expected[j] <= upper
    assert np.abs(covered / count - 0.9).max() < 4.5 * np.sqrt(0.09 / count)


def test_without_active_constraints_intervals_are_those_of_each_side_alone():
    """Both sides are independent, and every joint of the second is clearly stiffer."""
    twice = replace(MOTOR, stiffnesses=2 * MOTOR.stiffnesses)
    sides = [side(simulate_campaign(arm, load="pull", seed=4)) for arm in (MOTOR, twice)]
    pair = pair_of(*sides, ordered=True)
    assert not pair.ordered.equal.any()
    widths = np.diff(pair.ordered_intervals, axis=2)[..., 0] / (2 * T95)
    for estimate, width in zip((pair.first, pair.second), widths, strict=True):
        np.testing.assert_allclose(width, np.sqrt(np.diag(estimate.covariance)), rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_encoders_of_one_side_make_its_ratios_sharper(method):
    documents = [
        simulate_campaign(arm, load="pull", seed=k, configurations=12)
        for k, arm in enumerate((MOTOR, SECONDARY))
    ]
    read = with_encoders(MOTOR, documents[0], sigma=2e-6, noise=2e-6)
    plain = pair_of(*(side(document, method=method) for document in documents), ordered=True)
    sharp = pair_of(side(read, method=method), side(documents[1], method=method), ordered=True)
    for coarse, fine in zip(plain.joints, sharp.joints, strict=True):
        widths = [joint.interval.upper / joint.interval.lower for joint in (coarse, fine)]
        assert widths[1] < widths[0]
    assert (sharp.ordered.second <= sharp.ordered.first).all()
    errors = [np.abs(p.ordered.first / MOTOR.compliances - 1).max() for p in (plain, sharp)]
    assert errors[1] < min(errors[0], 0.02)


def test_an_assumed_load_point_cancels_only_if_both_assume_it_of_one_place():
    """Where one campaign states its own, or another point is loaded, its error is in the ratio."""
    first, second = simulated()

    def of(one, **common):
        uncertainty = CommonUncertainty(**common)
        return replace(one, measurements=replace(one.measurements, common_uncertainty=uncertainty))

    def widths(one, other):
        return [joint.interval.upper - joint.interval.lower for joint in pair_of(one, other).joints[2:5]]

    assumed = {"load_point": 0.01, "load_point_assumed": True}
    stated = widths(of(first, load_point=0.01), second)
    exact = widths(first, second)
    assert widths(of(first, **assumed), of(second, **assumed)) == pytest.approx(exact)
    assert widths(of(first, **assumed), second) == pytest.approx(stated)
    moved = replace(second.measurements, load_point=second.measurements.load_point + 0.1)
    elsewhere = of(replace(second, measurements=moved), **assumed)
    own = of(replace(second, measurements=moved), load_point=0.01)
    assert widths(of(first, **assumed), elsewhere) == pytest.approx(widths(of(first, load_point=0.01), own))
    assert all(np.array(stated) > 1.05 * np.array(exact))
