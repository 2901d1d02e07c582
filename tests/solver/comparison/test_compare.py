"""Comparisons of methods and of two campaigns, and trends of many, beside exact springs."""

import re
from dataclasses import dataclass, replace
from math import hypot, inf, log

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats
from scipy.optimize import nnls
from support.campaigns import METHODS, POINTS, prepare, settings_of, spring_columns, with_targets
from support.shared_data import shared
from support.springs import SpringCampaign, robot_of

from jointstiff.schemas.comparison import OrderedResult
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.campaign import deflections, plan_experiment
from jointstiff.simulator.document import experiment_of
from jointstiff.solver.comparison.campaigns import (
    Change,
    FreeEstimate,
    GaussianEstimate,
    RatioInterval,
    SharedErrors,
    Side,
    compare_sides,
    compute_measured_shares,
    compute_ratio_interval,
    find_force_unit_mistake,
    log_stiffness,
    match_observations,
    models_differ,
)
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.estimate import Estimate
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import CommonUncertainty, Measurements
from jointstiff.solver.mechanics.robot import Robot

MOTOR, SECONDARY = default_arm("motor"), default_arm("secondary")
T95 = 1.959963984540054
SIDES = ("first", "second")


@dataclass(frozen=True)
class Campaign:
    """A campaign as it was identified."""

    robot: Robot
    measurements: Measurements
    settings: Settings
    estimate: Estimate

    @property
    def side(self):
        """As stored runs give it: what a constraint holds is identified again without any."""
        estimate, free = self.estimate, self.estimate
        if any(joint.status == "at_bound" for joint in estimate.joints):
            without = replace(self.settings, bounds=Bounds.unconstrained(self.robot.n), order=())
            free = identify(Rows(self.robot, self.measurements), without)
        values = [np.nan if joint.compliance is None else joint.compliance for joint in free.joints]
        common = np.zeros((len(values), 0)) if free.common is None else free.common.responses
        scale, assumed = common[:, :0], common[:, :0]
        if free.common is not None:
            scale = free.common.responses_to("assumed_force_scale")
            assumed = free.common.responses_to("assumed_load_point")
        return Side(
            self.robot,
            self.measurements,
            estimate.compliance,
            self.settings.constraints,
            self.settings.complementary_stiffness,
            FreeEstimate(
                compliance=np.array(values),
                covariance=free.covariance,
                readings=None if free.covariance is None else free.covariance - common @ common.T,
                force_scale=scale @ scale.T,
                load_point=assumed,
                sigma=free.sigma,
                degrees_of_freedom=inf if free.sigma_given else free.degrees_of_freedom,
                reasons=[joint.reason for joint in free.joints],
                unseen=free.observability.null,
            ),
        )


@dataclass(frozen=True)
class Ordered:
    """The one problem as arrays."""

    result: OrderedResult

    @property
    def compliance(self):
        return self._of("compliance", np.nan)

    @property
    def intervals(self):
        return self._of("compliance_interval", (np.nan, np.nan))

    @property
    def equal(self):
        return np.array([joint.equal for joint in self.result.joints])

    def _of(self, name, unknown):
        rows = [[getattr(joint, f"{name}_{side}") for joint in self.result.joints] for side in SIDES]
        return np.array([[unknown if value is None else value for value in row] for row in rows])


def interval_of(joint):
    """Fieller's interval of a joint."""
    return (
        None if joint.ratio_interval is None else RatioInterval(*joint.ratio_interval, joint.ratio_excluded)
    )


def holds(interval, ratio):
    """Whether an interval holds a ratio; one that was cut out does not count."""
    if interval is None:
        return False
    above = interval.lower is None or ratio >= interval.lower
    below = interval.upper is None or ratio <= interval.upper
    out = interval.excluded is not None and interval.excluded[0] < ratio < interval.excluded[1]
    return above and below and not out


VALUES = st.floats(-10, 10).map(lambda x: 1e-7 * x)
SPREADS = st.floats(0.05, 5).map(lambda x: 1e-7 * x)


@given(VALUES, SPREADS, VALUES, SPREADS, st.floats(-20, 20), st.floats(-0.99, 0.99))
def test_every_ratio_is_in_or_out_as_the_definition_says(c1, s1, c2, s2, ratio, correlation):
    first, second = GaussianEstimate(c1, s1), GaussianEstimate(c2, s2)
    shared = correlation * s1 * s2
    margin = np.abs(c1 - ratio * c2) / np.sqrt(s1**2 - 2 * ratio * shared + (ratio * s2) ** 2) - T95
    assume(abs(margin) > 1e-6)
    free = compute_ratio_interval(first, second, 0.95, positive=False, covariance=shared)
    assert holds(free, ratio) == (margin < 0)
    positive = compute_ratio_interval(first, second, 0.95, positive=True, covariance=shared)
    assert holds(positive, ratio) == (margin < 0 and ratio >= 0)


def changed(campaign, **fields):
    """The campaign with other fields, identified anew."""
    new = replace(campaign, **fields)
    return replace(new, estimate=identify(Rows(new.robot, new.measurements), new.settings))


def with_readings(campaign, **readings):
    return changed(campaign, measurements=replace(campaign.measurements, **readings))


def side(document, **options):
    robot, measurements = prepare(document)
    settings = settings_of(robot, **options)
    return Campaign(robot, measurements, settings, identify(Rows(robot, measurements), settings))


def both(arms=(MOTOR, SECONDARY), seeds=(5, 6), options=None, **simulated):
    """Pulls on two arms, by default with motor and secondary encoders."""
    return tuple(
        side(simulate_campaign(arm, **{"load": "pull", "seed": seed, **simulated}), **(options or {}))
        for arm, seed in zip(arms, seeds, strict=True)
    )


def pair_of(first, second, *, ordered=False, confidence=0.95, **options):
    pair = compare_sides(first.side, second.side, confidence=confidence, ordered=ordered, **options)
    return pair._replace(ordered=Ordered(pair.ordered)) if ordered else pair


@pytest.fixture(scope="module")
def simulated():
    """Motor and secondary encoders, the same postures, independent noise."""
    first, second = both(seeds=(5, 5), readings="deflections")
    noise = np.random.default_rng(11).normal(0, 2e-5, second.measurements.deflection.shape)
    return first, with_readings(second, deflection=second.measurements.deflection + noise)


@pytest.mark.parametrize("method", METHODS)
def test_ratios_are_those_of_the_truth(method):
    """Joint 4 differs by 10 % in truth, which these readings cannot tell; the others can."""
    names = ("simulated/dead_weight_motor", "simulated/dead_weight_secondary")
    dead_weight = pair_of(*(side(shared(name), method=method) for name in names), ordered=True)
    truth = shared("simulated/truth")
    stiffness = [np.array(truth[f"dead_weight_{name}"]["stiffness"]) for name in ("motor", "secondary")]
    expected = stiffness[1] / stiffness[0]
    assert dead_weight.joints[0].ratio is None
    assert "never twists this joint" in dead_weight.joints[0].reason
    for joint, ratio in zip(dead_weight.joints[1:], expected[1:], strict=True):
        uncertainty = (interval_of(joint).upper - interval_of(joint).lower) / (2 * T95)
        assert abs(joint.ratio - ratio) < 4 * uncertainty, joint.name
        assert uncertainty < 0.1 * ratio
    p_values = [joint.p_value for joint in dead_weight.joints[1:]]
    assert all(p < 1e-3 for p in (*p_values[:2], *p_values[3:]))
    assert p_values[2] > 0.01


def test_the_difference_of_compliances_is_that_of_the_gearboxes(simulated):
    """Joints 1 to 3 have gearboxes inside the loop; the scale of one cell widens a difference only."""
    exact = pair_of(*simulated)
    removed = MOTOR.compliances - SECONDARY.compliances
    for joint, c in list(zip(exact.differences, removed, strict=True))[:3]:
        lower, upper = joint.compliance_interval
        assert lower <= c <= upper
        assert joint.status == "identified"
        assert joint.stiffness == pytest.approx(1.0 / joint.compliance)
        assert joint.stiffness_interval == pytest.approx((1.0 / upper, 1.0 / lower))
    assumed = CommonUncertainty(scale=0.05, assumed=frozenset({"force_scale"}))
    scaled = [
        replace(each, measurements=replace(each.measurements, common_uncertainty=assumed))
        for each in simulated
    ]
    with_scale = pair_of(*scaled, shared=SharedErrors(cell=True))
    for plain, wide in zip(exact.differences[:3], with_scale.differences[:3], strict=True):
        expected = hypot(plain.standard_uncertainty, 0.05 * plain.compliance)
        assert wide.standard_uncertainty == pytest.approx(expected, rel=1e-9)


def test_share_of_deflection_avoided_is_the_simulated_one():
    experiment = experiment_of(simulate_campaign(MOTOR, load="pull", seed=5))
    lengths = []
    for arm in (MOTOR, SECONDARY):
        unloaded, loaded = deflections(arm, experiment.joints, *experiment.wrenches, POINTS)
        lengths.append(np.linalg.norm(loaded - unloaded, axis=2))
    share = 1 - lengths[1].mean() / lengths[0].mean()
    avoided = pair_of(*both(seeds=(5, 5))).avoided
    assert [avoided.measured.value, avoided.predicted] == pytest.approx([share] * 2, rel=0.01)
    each = 1 - lengths[1].mean(axis=1) / lengths[0].mean(axis=1)
    for found, exact in zip(avoided.configurations, each, strict=True):
        assert abs(found.measured.value - exact) < 5 * found.measured.standard_uncertainty + 0.002  # by noise
        assert found.predicted == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", range(2))
def test_the_order_is_never_crossed_in_noise(method, seed):
    """The same arm twice: about half of the joints would cross."""
    sides = both((MOTOR, MOTOR), (seed, seed + 100), {"method": method}, configurations=8, sigma=3e-4)
    ordered = pair_of(*sides, ordered=True).ordered
    inside, (low, high) = ordered.compliance, np.moveaxis(ordered.intervals, -1, 0)
    assert (inside[1] <= inside[0]).all()
    assert ordered.equal.any()
    assert (low >= 0).all()
    assert ((low <= inside * (1 + 1e-9)) & (inside <= high * (1 + 1e-9))).all()
    assert (low[1] <= low[0] * (1 + 1e-9) + 1e-30).all()
    assert (high[1] <= high[0] * (1 + 1e-9)).all()


def _whitened(one):
    """A (9N, 6) and d of a campaign with deflections, by unit compliances of a simulator of ours."""
    m = one.measurements
    columns = spring_columns(m).reshape(-1, 6)
    return columns / (np.sqrt(2) * m.sigma), m.deflection.ravel() / (np.sqrt(2) * m.sigma)


@pytest.fixture(scope="module")
def crossing():
    """Two campaigns with the same arm and different noise, stated sigmas, in one problem; and their rows."""
    pull = {"load": "pull", "readings": "deflections", "configurations": 9}
    documents = (simulate_campaign(MOTOR, sigma=s, seed=k, **pull) for s, k in ((2e-4, 1), (4e-4, 2)))
    sides = [side(document) for document in documents]
    (A, a), (B, b) = map(_whitened, sides)
    M = np.block([[A, A], [B, np.zeros_like(B)]])
    return pair_of(*sides, ordered=True).ordered, M, np.concatenate([a, b]), (A, a), (B, b)


def _nnls(M, d):
    norms = np.linalg.norm(M, axis=0)
    x, norm = nnls(M / norms, d, maxiter=1000)
    return x / norms, norm**2


def test_the_ordered_optimum_is_that_of_an_independent_solver(crossing):
    ordered, M, d, one, two = crossing
    v, squares = _nnls(M, d)
    np.testing.assert_allclose(ordered.compliance[1], v[:6], rtol=1e-8, atol=1e-15)
    np.testing.assert_allclose(ordered.compliance[0], v[:6] + v[6:], rtol=1e-8)
    assert ordered.equal.tolist() == (v[6:] == 0).tolist()
    assert ordered.result.chi_square_increase == pytest.approx(
        squares - _nnls(*one)[1] - _nnls(*two)[1], rel=1e-6
    )


@pytest.mark.parametrize("j", range(6))
def test_ordered_intervals_end_where_the_likelihood_has_fallen_by_its_quantile(crossing, j):
    ordered, M, d, *_ = crossing
    least = _nnls(M, d)[1]
    others = np.delete(np.arange(12), j)
    for end in ordered.intervals[1, j]:
        if end == 0.0:
            continue
        at_end = _nnls(M[:, others], d - M[:, j] * end)[1]
        assert at_end - least == pytest.approx(T95**2, rel=1e-6)


def test_uncertainty_of_the_measured_share_is_what_noise_does(simulated):
    readings = [one.measurements for one in simulated]
    matches = match_observations(*readings)
    sigma, rng = 2e-5, np.random.default_rng(3)
    values = []
    for _ in range(500):
        noisy = []
        for one in readings:
            read = one.deflection + rng.normal(0, np.sqrt(2) * sigma, one.deflection.shape)
            noisy.append(replace(one, deflection=read))
        each, overall = compute_measured_shares(noisy, matches, (sigma, sigma))
        values.append((overall.value, each[0].value))
    each, overall = compute_measured_shares(readings, matches, (sigma, sigma))
    stated = overall.standard_uncertainty, each[0].standard_uncertainty
    np.testing.assert_allclose(np.std(values, axis=0), stated, rtol=4.5 / np.sqrt(2 * 500))


def test_labels_find_each_other_in_any_order_but_in_other_postures_and_loads(simulated):
    first, second = simulated
    m = second.measurements
    joints, force, point = m.joints.copy(), m.force.copy(), m.load_point.copy()
    joints[0, 2] += 2e-3
    force[1] *= 1.01
    point[2, 0] += 2e-3
    joints[3, 2] += 1e-4
    moved = with_readings(second, joints=joints, force=force, load_point=point)
    order = np.random.default_rng(1).permutation(19)
    shuffled = changed(moved, measurements=moved.measurements[order])
    straight, (*_, avoided, unlike, _) = pair_of(first, moved).avoided, pair_of(first, shuffled)
    assert unlike == ("c01", "c02", "c03")
    assert [one.side for one in avoided.configurations] == ["first"] * 3 + ["both"] * 16 + ["second"] * 3
    assert avoided.matching == 16
    assert avoided.measured.value == pytest.approx(straight.measured.value)
    assert avoided.predicted == pytest.approx(straight.predicted)


@pytest.mark.parametrize(
    ("scaled", "factor", "moved", "named"),
    [
        (
            19,
            1.0 / 9.80665,
            1.0,
            "0.102 times those .* kgf were read as N in the second campaign, or N as kgf",
        ),
        (10, 9.80665, 1.0, "9.81 times .* N were read as kgf in"),  # of 19
        (9, 9.80665, 1.0, None),
        (19, 1e-3, 0.6, "0.001 times .* the deflections 0.6 times: probably kN were read as N in"),
        (19, 1e3, 1.4, "1000 times .* the deflections 1.4 times: probably N were read as kN in"),
        (19, 9.80665, 9.80665, None),  # as much more load
    ],
)
def test_forces_of_most_observations_in_another_unit_are_named(simulated, scaled, factor, moved, named):
    first, second = (one.measurements for one in simulated[:1] * 2)
    force = second.force.copy()
    force[:scaled] *= factor
    other = replace(second, force=force, deflection=moved * second.deflection)
    found = find_force_unit_mistake(first, other, match_observations(first, other))
    assert found is None if named is None else re.search(named, found.message)
    still = replace(first, deflection=0.0 * first.deflection)
    assert find_force_unit_mistake(still, other, match_observations(still, other)) is None


def test_robots_that_differ_are_noticed_by_their_model(simulated):
    first, second = (one.robot for one in simulated)
    assert models_differ(
        first, prepare(simulate_campaign(default_arm(wrist_offset=0.01), configurations=1))[0]
    )
    assert not models_differ(first, second)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_ratio_intervals_cover(method):
    """300 pairs of campaigns of exact springs, small load: the intervals cover as often as they say."""
    count, expected = 300, SECONDARY.stiffnesses / MOTOR.stiffnesses
    covered = np.zeros(6)
    for k in range(count):
        sides = both(seeds=(2 * k, 2 * k + 1), options={"method": method}, force=300.0)
        joints = pair_of(*sides, confidence=0.9).joints
        covered += [holds(interval_of(joint), ratio) for joint, ratio in zip(joints, expected, strict=True)]
    assert np.abs(covered / count - 0.9).max() < 4.5 * np.sqrt(0.09 / count)


def test_the_load_point_of_each_campaign_is_in_the_ratio_assumed_or_stated(simulated):
    """A load that is hung anew hangs elsewhere, so that the errors of two campaigns do not cancel."""
    first, second = simulated

    def of(one, *, assumed):
        uncertainty = CommonUncertainty(load_point=0.01, assumed=frozenset({"load_point"} if assumed else ()))
        return with_readings(one, common_uncertainty=uncertainty)

    def widths(one, other):
        return [float(np.diff(joint.ratio_interval)[0]) for joint in pair_of(one, other).joints[2:5]]

    exact, one = widths(first, second), widths(of(first, assumed=True), second)
    assert one == pytest.approx(widths(of(first, assumed=False), second))
    both_assumed = widths(of(first, assumed=True), of(second, assumed=True))
    both_stated = widths(of(first, assumed=False), of(second, assumed=False))
    assert both_assumed == pytest.approx(both_stated)
    assert (np.array(both_assumed) > 1.01 * np.array(one)).all()
    assert (np.array(one) > 1.01 * np.array(exact)).all()


def with_load_point_uncertainty(campaign, size=0.01):
    """The campaign with a load point that is known to so many metres."""
    return with_readings(
        campaign, common_uncertainty=CommonUncertainty(load_point=size, assumed=frozenset({"load_point"}))
    )


def hung_off(arm, plan, offset, seed):
    """The pulls of a plan whose load hung off the stated point, read with 20 µm, the point known to 10 mm."""
    campaign = SpringCampaign.by(arm, replace(plan, load_points=plan.load_points + offset))
    noise = 2e-5 * np.random.default_rng(seed).standard_normal((2, *campaign.loaded.shape))
    measurements = replace(campaign, experiment=plan).measurements(
        campaign.unloaded + noise[0], campaign.loaded + noise[1], sigma=2e-5
    )
    robot = robot_of(arm)
    uncertainty = CommonUncertainty(load_point=0.01, assumed=frozenset({"load_point"}))
    measurements = replace(measurements, common_uncertainty=uncertainty)
    settings = settings_of(robot)
    return Campaign(robot, measurements, settings, identify(Rows(robot, measurements), settings))


@pytest.mark.slow
def test_ratios_of_loads_at_one_point_cover_with_narrower_intervals():
    """100 pairs of campaigns whose load hung at one point, 10 mm (1 sigma) off the stated one."""
    count, level, expected = 100, 0.9, SECONDARY.stiffnesses / MOTOR.stiffnesses
    truth = 1.0 / np.stack([MOTOR.stiffnesses, SECONDARY.stiffnesses])
    covered, inside, widths = np.zeros(6), np.zeros((2, 6)), []
    for k in range(count):
        offset = 0.01 * np.random.default_rng([k, 7]).standard_normal(3)
        plan = plan_experiment(MOTOR, configurations=16, load="pull", force=1500.0, seed=k)
        sides = [hung_off(arm, plan, offset, [k, i]) for i, arm in enumerate((MOTOR, SECONDARY))]
        shared = pair_of(*sides, confidence=level, ordered=True, shared=SharedErrors(load=True))
        own = pair_of(*sides, confidence=level)
        covered += [holds(interval_of(j), ratio) for j, ratio in zip(shared.joints, expected, strict=True)]
        widths.append([[np.diff(j.ratio_interval)[0] for j in pair.joints] for pair in (shared, own)])
        low, high = np.moveaxis(shared.ordered.intervals, -1, 0)
        inside += (low <= truth) & (truth <= high)
    slack = 4.5 * np.sqrt(level * (1 - level) / count)
    assert np.abs(covered / count - level).max() < slack
    assert (inside / count).min() > level - slack  # the order only cuts off what is wrong
    narrower, wider = np.median(np.array(widths), axis=0)
    assert (narrower < 1.001 * wider).all()
    assert (narrower / wider).min() < 0.9


def test_an_error_of_the_load_point_that_both_campaigns_share_leaves_the_ratio_of_alike_campaigns(simulated):
    """By arithmetic: var(c1 - c2) = 2 (s² - r²), where r is what one error does to either compliance."""
    first = with_load_point_uncertainty(simulated[0])
    common = first.estimate.common.responses_to("assumed_load_point")
    own = np.sqrt(np.diagonal(first.estimate.covariance - common @ common.T))
    for joint, c, s in zip(
        pair_of(first, first, shared=SharedErrors(load=True)).joints,
        first.estimate.compliance,
        own,
        strict=True,
    ):
        # Near the ratio 1, the ends of Fieller's interval are those of the difference of logarithms.
        assert np.diff(np.log(joint.ratio_interval))[0] == pytest.approx(
            2 * T95 * np.sqrt(2) * s / c, rel=0.02
        )
        assert joint.ratio == 1.0


@pytest.mark.parametrize("what", ["point", "uncertainty", "none"])
def test_campaigns_that_state_other_load_points_do_not_share_one(simulated, what):
    first, second = map(with_load_point_uncertainty, simulated)
    if what == "point":
        second = with_readings(
            second, load_point=second.measurements.load_point + np.array([0.002, 0.0, 0.0])
        )
    elif what == "uncertainty":
        second = with_load_point_uncertainty(second, 0.005)
    else:
        second = simulated[1]
    with pytest.raises(RequestError, match="no uncertainty" if what == "none" else "apart") as error:
        pair_of(first, second, shared=SharedErrors(load=True))
    assert error.value.where == "same_load"


def with_scale(campaign, size=0.01):
    """The campaign with forces whose scale is assumed to be known to a fraction."""
    uncertainty = CommonUncertainty(scale=size, assumed=frozenset({"force_scale"}))
    return with_readings(campaign, common_uncertainty=uncertainty)


def test_an_assumed_scale_is_each_campaigns_own_unless_the_cell_is_said_to_be_the_same(simulated):
    """By arithmetic: an error of 1 % of each force adds √2 % to the ratio."""

    def uncertainties(one, other, **options):
        joints = pair_of(one, other, **options).joints
        return np.array([np.diff(np.log(joint.ratio_interval))[0] / (2.0 * T95) for joint in joints])

    exact = uncertainties(*simulated)
    first, second = map(with_scale, simulated)
    same_cell = SharedErrors(cell=True)
    np.testing.assert_allclose(uncertainties(first, second, shared=same_cell), exact, rtol=0.01)
    expected = np.hypot(exact, 0.01 * np.sqrt(2.0))
    np.testing.assert_allclose(uncertainties(first, second), expected, rtol=0.02)


def test_campaigns_of_other_uncertainties_of_the_force_have_no_cell_in_common(simulated):
    first, second = with_scale(simulated[0]), with_scale(simulated[1], 0.003)
    with pytest.raises(RequestError, match=r"uncertainties of 1 and 0\.3 %") as error:
        pair_of(first, second, shared=SharedErrors(cell=True))
    assert error.value.where == "same_cell"


def test_targets_that_were_not_read_do_not_weigh_in_the_share_of_deflection():
    """Of each observation the mean over the targets that were read, of all their sum."""
    present = np.random.default_rng(4).random((19, 3)) < 0.6
    present[np.arange(19), np.arange(19) % 3] = True
    sides = [
        changed(one, measurements=with_targets(one.measurements, present))
        for one in both(seeds=(5, 5), readings="deflections")
    ]
    columns = spring_columns(sides[0].measurements)
    lengths = [
        (np.linalg.norm(columns @ one.estimate.compliance, axis=2) * present).sum(axis=1)
        / present.sum(axis=1)
        for one in sides
    ]
    avoided = pair_of(*sides).avoided
    assert avoided.predicted == pytest.approx(1.0 - lengths[1].sum() / lengths[0].sum(), rel=1e-6)
    for found, first, second in zip(avoided.configurations, *lengths, strict=True):
        assert found.predicted == pytest.approx(1.0 - second / first, rel=1e-5)


def test_a_change_has_the_uncertainty_of_what_the_campaigns_do_not_share() -> None:
    """By arithmetic: u(c)/c of 3 and 4 %, of which 2.4 % is the scale of one load cell."""
    first = log_stiffness(1e-6, 3e-8, shared_uncertainty=2.4e-8)
    second = log_stiffness(1.1e-6, 4.4e-8)
    assert first == pytest.approx((log(1e6), 0.018))
    shared = Change.between(first, second, shared=0.03)
    assert shared.standard_uncertainty == pytest.approx(hypot(0.018, 0.04, 0.03))
    change = Change.between(first, second)
    assert change.relative == pytest.approx(1 / 1.1 - 1.0)
    assert change.standard_uncertainty == pytest.approx(hypot(0.018, 0.04))
    chance = 2.0 * stats.norm.sf(log(1.1) / hypot(0.018, 0.04))
    assert change.p_value == pytest.approx(chance)
    assert change.is_significant(1)
    assert not change.is_significant(3)


@pytest.mark.parametrize(("c", "u"), [(None, None), (0.0, 1e-8), (-1e-7, 1e-8), (1e-6, 2.6e-7)])
def test_a_stiffness_without_an_upper_end_is_not_compared(c: float | None, u: float | None) -> None:
    assert log_stiffness(c, u) is None


def test_of_robots_that_did_not_change_few_are_said_to_have() -> None:
    """4,000 robots of six joints: at most 5 % in any joint, by Boole; 6.1 % of them would be p = 0.001."""
    values = 0.03 * np.random.default_rng(5).standard_normal((4_000, 6, 2))
    changed = [
        any(Change.between((a, 0.03), (b, 0.03)).is_significant(6) for a, b in robot) for robot in values
    ]
    assert np.mean(changed) <= 0.061


@pytest.mark.parametrize("freedom", [3, 12, 40])
def test_of_robots_that_did_not_change_few_are_said_to_have_by_an_estimated_sigma(freedom: int) -> None:
    """The sigma of each small campaign comes from its residuals; the normal test called 8 % of 12 changed."""
    random = np.random.default_rng(6)
    values = 0.03 * random.standard_normal((8_000, 6, 2))
    sigmas = 0.03 * np.sqrt(random.chisquare(freedom, (8_000, 2)) / freedom)
    changed = [
        any(Change.between((a, u), (b, v), freedom).is_significant(6) for a, b in robot)
        for robot, (u, v) in zip(values.tolist(), sigmas.tolist(), strict=True)
    ]
    assert np.mean(changed) <= 0.057


def test_each_campaigns_own_order_holds_in_the_one_problem(simulated):
    """Joint 6, which is the softest, is to be as stiff as joint 2 in one of them."""
    constraints = Constraints(Bounds.positive(6), ((5, 1),))
    for which in (0, 1):
        sides = [one.side for one in simulated]
        sides[which] = replace(sides[which], constraints=constraints)
        found = Ordered(compare_sides(*sides, confidence=0.95, ordered=True).ordered).compliance
        assert (found[:, 5] == found[:, 1]).tolist() == [which == 0, which == 1]


def test_an_order_that_the_readings_contradict_is_refused_until_the_campaigns_are_exchanged():
    motor, secondary = both()
    with pytest.raises(RequestError, match=r"joint_2 \(0\.\d+ times\)") as error:
        pair_of(secondary, motor, ordered=True)
    assert (error.value.where, error.value.remedy) == (
        "ordered",
        "exchange the two campaigns, or omit `ordered`",
    )
    assert pair_of(motor, secondary, ordered=True).ordered is not None
    assert pair_of(secondary, motor).ordered is None


@pytest.mark.parametrize("freedoms", [(3.0, inf), (inf, 5.0)])
def test_the_fewer_degrees_of_freedom_count(simulated, freedoms):
    free = [replace(one.side.free, degrees_of_freedom=f) for one, f in zip(simulated, freedoms, strict=True)]
    sides = [replace(one.side, free=own) for one, own in zip(simulated, free, strict=True)]
    result = compare_sides(*sides, confidence=0.9, ordered=True)
    t, (c, d) = stats.t.ppf(0.95, min(freedoms)), (own.compliance for own in free)
    u, v = (np.sqrt(np.diag(own.covariance)) for own in free)
    chances = 2.0 * stats.t.sf(np.abs(c - d) / np.hypot(u, v), min(freedoms))
    np.testing.assert_allclose([joint.p_value for joint in result.joints], chances)
    ends = np.array([joint.ratio_interval for joint in result.joints]).T
    np.testing.assert_allclose(np.abs(c - ends * d), t * np.hypot(u, ends * v))
    width = np.ptp(result.ordered.joints[1].compliance_interval_first)  # which the order hardly cuts
    assert width == pytest.approx(2.0 * t * u[1], rel=2e-3)


@pytest.mark.parametrize(
    ("field", "change", "near", "far"),
    [
        ("joints", lambda q, x: q + x * np.eye(6)[2], 9e-4, 1.1e-3),  # 1 mrad
        ("load_point", lambda p, x: p - x * np.array([0.6, 0.0, 0.8]), 9e-4, 1.1e-3),  # 1 mm
        ("force", lambda f, x: (1.0 + x) * f, 5.01e-3, 5.1e-3),  # half a percent of the larger one
        ("moment", lambda m, x: m / (1.0 + x), 5.01e-3, 5.1e-3),
        (
            "direction",
            lambda d, x: np.sin(x) * np.eye(3)[1] - np.cos(x) * d,
            1.9e-3,
            2.1e-3,
        ),  # 2 mrad, to either side
        ("direction", lambda d, x: x * d, 1.0, 0.0),  # all three coordinates
    ],
)
def test_observations_are_alike_within_tolerances(simulated, field, change, near, far):
    read = simulated[0].measurements
    one = replace(read, moment=np.full((19, 3), 50.0), direction=np.tile(np.eye(3)[0], (19, 3, 1)))
    for size, count in ((near, 57), (far, 0)):
        other = replace(one, **{field: change(getattr(one, field), size)})
        assert (
            match_observations(one, other).present.sum()
            == match_observations(other, one).present.sum()
            == count
        )
    still = replace(one, force=np.zeros((19, 3)))  # a moment alone acts anywhere
    assert match_observations(still, replace(still, load_point=still.load_point + 1.0)).present.all()
