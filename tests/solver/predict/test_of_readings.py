"""Predictions of a model that readings determine: what is known how well, what is unknown, and why."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import ARM
from support.springs import SpringCampaign, load_cases, robot_of

from jointstiff.solver.errors import JointstiffError
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.method import Settings
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.predict.answers import STATUSES, MapTask, compute_tool_rotations, map_places
from jointstiff.solver.predict.forward import CorrectionLimits, compensate, compute_ramp_shares
from jointstiff.solver.predict.models import JointModel, ModelError, estimate_error_by_leaving_postures_out

ROBOT = robot_of(ARM)
POSITIVE = Constraints(Bounds.positive(6))
SETTINGS = Settings("partial_pose", "covariance", Bounds.positive(6))
EXACT = JointModel(ROBOT, ARM.compliances, None, POSITIVE)
CASES = load_cases(ARM, 6, force=1500.0, moment=150.0, seed=0)
READ = next(iter(SpringCampaign.of(ARM).measured(1, seed=4)))
"""Readings under forces in all directions."""
DOWN = replace(READ, force=np.tile([0.0, 0.0, -1500.0], (len(READ), 1)))
"""Readings taken for those under a weight, which does not twist the first joint."""


def of_readings(measurements):
    """Return the model of readings, and its error at postures that are left out."""
    found = identify(Rows(ROBOT, measurements), SETTINGS)
    model = JointModel.from_estimate(ROBOT, found, SETTINGS.constraints)
    return model, estimate_error_by_leaving_postures_out(Rows(ROBOT, measurements), SETTINGS, found, model)


MODEL, ERROR = of_readings(READ)
BLIND, _ = of_readings(DOWN)


def half(interval):
    return (interval[..., 1] - interval[..., 0]) / 2


def test_a_model_of_readings_bends_nearly_as_the_arm_and_says_how_nearly():
    truth, found = EXACT.deflect(CASES), MODEL.deflect(CASES)
    assert 1e3 * truth.displacement[0] == pytest.approx([-3.852521, -1.371791, 1.722843], abs=1e-6)
    assert 1e3 * found.displacement[0] == pytest.approx([-3.847744, -1.374072, 1.719346], abs=1e-5)
    assert 1e3 * found.rotation[0] == pytest.approx([1.05217, -0.490302, 2.389888], abs=1e-5)
    assert 1e5 * found.leverage[:3] == pytest.approx([1.098253, 1.371819, 0.6386195], rel=1e-4)
    interval = found.interval(0.9)
    motion = np.hstack([found.displacement, found.rotation])
    assert interval.mean(axis=-1) == pytest.approx(motion, abs=1e-12)
    widths = [15.339279, 8.10322, 7.9584, 28.145945, 93.814673, 93.399207]
    assert 1e6 * half(interval)[0] == pytest.approx(widths, rel=1e-4)
    along = 1e3 * found.interval_along(np.tile([0.6, 0.0, 0.8], (6, 1)), 0.9)
    assert along[0] == pytest.approx([-0.93848, -0.92786], abs=1e-5)
    assert truth.interval(0.9) is None
    assert not np.hstack([truth.unseen, found.unseen, truth.leverage[:, None]]).any()


def test_a_joint_that_no_load_twisted_is_unseen_in_all_cases():
    assert BLIND.deflect(CASES).unseen.tolist() == [[True, False, False, False, False, False]] * 6


def test_compliances_have_an_uncertainty_and_a_worst_direction():
    found = MODEL.deflect(CASES).compliance
    u = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0, 0.8], [0, -0.6, 0.8], [0.8, 0.6, 0]], dtype=float)
    along, across, worst = found.compliance_along(u), found.greatest_compliance_across(u), found.worst
    assert 1e6 * along == pytest.approx([3.141895, 2.423065, 1.971073, 0.155313, 2.199808, 2.15969], rel=1e-4)
    assert 1e6 * across == pytest.approx(
        [1.777102, 2.757403, 1.646789, 3.682386, 1.899832, 2.158045], rel=1e-4
    )
    assert 1e6 * worst.compliance[:3] == pytest.approx([3.851269, 2.792791, 2.186252], rel=1e-4)
    assert 1e9 * worst.compliance_uncertainty[:3] == pytest.approx([7.233, 4.574, 5.506], rel=1e-3)
    assert 1e3 * worst.direction_uncertainty[:3] == pytest.approx([1.023, 9.169, 7.253], rel=1e-3)
    assert (np.maximum(along, across) <= worst.compliance * (1 + 1e-12)).all()
    assert (across <= np.linalg.eigvalsh(found.translation)[:, -1] * (1 + 1e-12)).all()
    stiffnesses = found.stiffness_lateral_free(u), found.stiffness_lateral_blocked(u)
    assert (stiffnesses[0] <= stiffnesses[1]).all()
    assert (stiffnesses[1] <= found.stiffness_rotation_blocked(u)).all()
    assert found.stiffness_lateral_free(u) == pytest.approx(1 / along, rel=1e-12)
    assert found.stiffness_rotation_blocked(u)[:2] == pytest.approx([5027787.8, 1566028.0], rel=1e-4)
    assert not found.symmetric.any()  # under moments


def test_the_model_error_is_a_quantile_over_postures_that_were_left_out():
    levels = [1e6 * ERROR.quantile(level) for level in (0.5, 0.8, 0.9, 0.95)]
    assert levels == pytest.approx([12.88179, 21.66757, 24.45317, 32.44963], rel=1e-4)
    assert ERROR.quantile(0.99) == np.inf
    assert ERROR.postures == 19
    assert [ModelError.count_needed_postures(level) for level in (0.5, 0.9, 0.95, 0.99)] == [1, 9, 19, 99]


def test_few_postures_bound_no_high_confidence():
    _, few = of_readings(READ[np.arange(10)])
    assert (few.postures, few.quantile(0.95)) == (10, np.inf)
    assert 1e6 * few.quantile(0.5) == pytest.approx(18.67008, rel=1e-4)
    assert 1e6 * few.quantile(0.9) == pytest.approx(43.4274, rel=1e-4)


def test_the_model_error_counts_postures_and_needs_two():
    assert of_readings(READ[np.array([0, 0, 0, 1, 1, 1])])[1].postures == 2
    with pytest.raises(JointstiffError) as caught:
        of_readings(replace(READ[np.arange(6)], joints=np.repeat(READ.joints[:1], 6, axis=0)))
    assert str(caught.value) == "the model error needs two postures under load; measure more postures"


@pytest.mark.parametrize(
    ("factor", "radius", "ratio"), [(0.1, 24.4532, 0.1), (1.0, 24.4532, 1.0), (3.0, 73.3595, 3.0)]
)
def test_the_model_error_grows_with_loads_beyond_those_measured(factor, radius, ratio):
    cases = load_cases(ARM, 6, force=1500.0 * factor, moment=0.0, seed=0)
    found = MODEL.deflect(cases)
    bound = ERROR.bound(cases, found.leverage, 0.9)
    assert 1e6 * bound.radius == pytest.approx([radius] * 6, rel=1e-4)
    assert bound.load_ratio == pytest.approx([ratio] * 6, rel=1e-4)
    assert bound.leverage_ratio[0] == pytest.approx(0.774, abs=1e-3)
    ends = bound.interval(found.displacement, found.interval(0.9))
    assert half(ends) == pytest.approx(np.maximum(half(found.interval(0.9))[:, :3], radius * 1e-6), rel=1e-4)


def test_the_error_of_a_kind_of_load_that_was_not_measured_is_unbounded():
    found = MODEL.deflect(CASES)
    bound = ERROR.bound(CASES, found.leverage, 0.9)
    assert bound.unmeasured == "moment"
    assert np.isinf([bound.radius, bound.load_ratio]).all()
    assert not bound.leverage_ratio.any()
    ends = bound.interval(found.displacement, found.interval(0.9))
    assert np.isinf(ends).all()
    assert (ends[..., 0] < ends[..., 1]).all()


FREE = np.tile([-np.inf, np.inf], (6, 1))
AREA = np.array([[9.0, 0.0, 0.0], [1.2, -0.6, 0.4], [1.6, 0.0, 0.9], [2.0, 0.6, 0.9]])
"""The first place is out of reach."""


def mapped(model, error=None, *, force=(0.0, 800.0, 300.0), turns=2, near=None, limits=FREE):
    """Map the area; return the statuses and what was found."""
    towards = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, -0.8]])
    rotation = compute_tool_rotations(np.array([0.0, 0.0, 1.0]), towards, turns)
    unit, ones = np.array(force) / np.linalg.norm(force), np.ones((len(rotation), 1))
    wrench = ones * force, np.zeros((len(rotation), 3)), ones * unit
    tool, load_point = np.array([0.0, 0.0, 0.25]), np.array([0.0, 0.0, 0.1])
    task = MapTask(rotation, *wrench, tool, load_point, limits, near, 0.95)
    found = map_places(model, error, task, InverseKinematics(ROBOT), AREA)
    return [STATUSES[each] for each in found.status], found


def unknown(found):
    """Return the names of what is unknown at the places within reach."""
    names = ("joints", "displacement", "along", "across", "readings", "with_model_error")
    return [name for name in names if np.isnan(getattr(found, name)[1:]).all()]


def test_a_map_has_displacements_and_compliances_where_the_tool_reaches():
    statuses, found = mapped(EXACT)
    assert statuses == ["out_of_reach", "reached", "reached", "reached"]
    assert unknown(found) == ["readings", "with_model_error"]
    assert np.isnan(found.joints[0]).all()
    assert 1e3 * found.displacement[1] == pytest.approx([-0.112074, 0.54628, -0.003787], abs=1e-5)
    assert 1e6 * found.along[1:] == pytest.approx([0.696128, 0.87942, 1.665718], rel=1e-4)
    assert 1e6 * found.across[1:] == pytest.approx([2.053377, 2.278542, 1.814316], rel=1e-4)
    assert found.orientation.tolist()[1:] == [1, 3, 1]


@pytest.mark.parametrize(
    ("force", "turns", "readings", "error"),
    [
        ((0.0, 800.0, 300.0), 2, [543.4775, 556.4321], [517.5052, 582.4044]),
        ((0.0, 8000.0, 3000.0), 1, [5437.961, 5570.003], [5319.149, 5688.815]),
    ],
)
def test_a_map_of_readings_bounds_the_length_of_displacements(force, turns, readings, error):
    statuses, found = mapped(MODEL, ERROR, force=force, turns=turns)
    assert statuses == ["out_of_reach", "reached", "reached", "reached"]
    assert unknown(found) == []
    assert 1e6 * found.readings[1] == pytest.approx(readings, rel=1e-4)
    assert 1e6 * found.with_model_error[1] == pytest.approx(error, rel=1e-4)
    assert np.isnan(found.readings[0]).all()


@pytest.mark.parametrize(
    ("model", "options", "status", "missing"),
    [
        (EXACT, {"limits": np.where(np.arange(6)[:, None] == 1, [2.0, 2.1], FREE)}, "joint_limits", 6),
        (EXACT, {"force": (0.0, 9e6, 0.0)}, "overloaded", 5),
        (BLIND, {}, "unseen_joint", 5),
    ],
    ids=["joint_limits", "overloaded", "unseen_joint"],
)
def test_a_place_without_an_answer_has_its_reason_and_no_numbers(model, options, status, missing):
    statuses, found = mapped(model, **options)
    assert statuses == ["out_of_reach", status, status, status]
    assert len(unknown(found)) == missing  # all, or all but the posture
    assert np.isfinite(found.joints[1:]).all() == (missing == 5)


def test_a_load_that_needs_no_unseen_joint_has_an_answer_along_itself_alone():
    statuses, found = mapped(BLIND, force=(0.0, 0.0, -900.0))
    assert statuses == ["out_of_reach", "reached", "reached", "reached"]
    assert unknown(found) == ["across", "with_model_error"]
    assert 1e6 * found.along[1:] == pytest.approx([0.032252, 0.050831, 0.097407], rel=1e-3)


def test_a_map_keeps_near_a_posture():
    statuses, found = mapped(EXACT, near=np.array([0.2, 0.1, -0.3, 0.1, 0.4, 6.0]), turns=1)
    assert statuses[1:] == ["reached"] * 3
    turns = [-0.58494, 0.047532, 1.002844, -1.679706, 0.339763, 5.315049]
    assert found.joints[1] == pytest.approx(turns, abs=1e-5)
    assert 1e6 * found.along[1:] == pytest.approx([1.188837, 1.108894, 1.863849], rel=1e-4)


@pytest.mark.parametrize(
    ("limits", "capped", "share", "residual"),
    [
        (CorrectionLimits(displacement=5e-4), 40, 0.143822, 1.398378),
        (CorrectionLimits(1.0, 1.0), 0, 1.0, 0.0),
        (CorrectionLimits(1.0, 2e-4), 40, 0.060599, 1.534179),
    ],
    ids=["short", "whole", "little turn"],
)
def test_a_correction_is_held_back_by_its_limits(limits, capped, share, residual):
    cases = load_cases(ARM, 40, force=1500.0, moment=0.0, seed=5)
    point = np.tile([0.0, 0.05, 0.25], (40, 1))
    cases = replace(cases, load_point=point, place=point.copy())
    found = compensate(MODEL, cases, limits, compute_ramp_shares(ROBOT, cases, 0.0))
    assert (found.capped.sum(), found.share[20]) == (capped, pytest.approx(share, rel=1e-4))
    uncorrected = [1.633048, -0.600057, 3.016513, 2.46979, -1.894982, -1.115626]
    assert 1e3 * found.uncorrected[20] == pytest.approx(uncorrected, abs=1e-4)
    assert 1e3 * found.residual[20, 0] == pytest.approx(residual, abs=1e-4)
    assert np.linalg.norm(found.correction[:, :3], axis=1).max() <= limits.displacement * 1.01
    assert np.linalg.norm(found.correction[:, 3:], axis=1).max() <= limits.rotation * 1.01
    # The correction moves the tool against its displacement.
    assert found.correction[20] == pytest.approx(-share * found.uncorrected[20], rel=0.02)


@pytest.mark.parametrize(
    ("ramp", "shares"),
    [
        (0.8, [0.0, 0.798995, 1.0, 1.0, 0.768023, 0.0]),
        (30.0, [0.0, 0.021307, 0.134787, 0.166729, 0.020481, 0.0]),
    ],
)
def test_corrections_begin_and_end_with_the_load(ramp, shares):
    cases = load_cases(ARM, 40, force=1500.0, moment=0.0, seed=5)
    point, force = np.tile([0.0, 0.05, 0.25], (40, 1)), cases.force.copy()
    force[:5] = force[-8:] = 0.0
    found = compute_ramp_shares(ROBOT, replace(cases, load_point=point, place=point, force=force), ramp)
    assert found[[5, 6, 7, 29, 30, 31]] == pytest.approx(shares, abs=1e-5)
    assert not found[[*range(5), *range(32, 40)]].any()
    assert found.max() == 1.0
