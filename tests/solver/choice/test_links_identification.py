"""Elastic links against an arm that shares no code with us, and against the real readings."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.campaigns import prepare
from support.shared_data import shared

from jointstiff.schemas.options import CrossValidation
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.elastic_links import beam_arm, elastic_campaign
from jointstiff.solver.choice import held_out as choice
from jointstiff.solver.choice.held_out import (
    LIMITS,
    WEIGHTS,
    WITH_BASE,
    Folds,
    HeldOut,
    PenaltyPath,
    Selection,
    choose_weight_index,
    draw_folds,
    find_richest_model,
    fit_first_certified,
    fit_fold,
    fit_folds,
    list_models_to_compare,
    refine_path,
    report_losses,
    report_penalty,
    select_model,
)
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fit.cone import to_vector
from jointstiff.solver.fit.conic import compute_unconstrained_range
from jointstiff.solver.fit.effective import (
    EffectiveCompliances,
    build_effective_rows,
    compute_effective_compliances,
)
from jointstiff.solver.fit.part import Part, compress_parts, generate_elastic_rows
from jointstiff.solver.fit.prior import Prior
from jointstiff.solver.fit.problem import LeastSquares
from jointstiff.solver.fit.reduced import (
    LOSSES,
    Candidate,
    HuberLoss,
    fit_loss,
    list_losses_to_compare,
    reduce_part,
)
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.mechanics.block import regressor_blocks
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.measurements import CommonUncertainty, EncoderReadings
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.terms import list_stated_terms
from jointstiff.solver.models import ELASTIC_MODELS, Columns, find_model
from jointstiff.solver.predict.answers import build_forward_model, build_stored_model
from jointstiff.solver.predict.models import ElasticPredictor, estimate_error_by_leaving_folds_out

MODELS = tuple(model.name for model in ELASTIC_MODELS)
COLUMNS = Columns(6, tuple(range(6)))
VISIBLE = np.ones(6, dtype=bool)


def truth_of(elastic):
    out = np.zeros(COLUMNS.width)
    out[COLUMNS.joints] = elastic.arm.compliances
    for joint, link in enumerate(elastic.links):
        out[COLUMNS.link_columns(joint)] = to_vector(link)
    return out


def rows_of(robot, measurements):
    return np.concatenate(
        [each.targets[..., :-1] for each in generate_elastic_rows(Rows(robot, measurements), COLUMNS)]
    )


def whole_rows(robot, measurements):
    (rows,) = compress_parts(Rows(robot, measurements), COLUMNS, [np.arange(len(measurements))])
    return rows


def estimate(robot, measurements, name="joints_and_links", weight=1e-2, *, columns=COLUMNS, **options):
    """Estimate with options of the model (loss, threshold), of the folds (shares), and of what is visible."""
    shares, statements = options.pop("shares", CrossValidation()), options.pop("statements", None)
    folds = Folds(Rows(robot, measurements), columns, options.pop("visible", VISIBLE), shares, statements)
    loss, threshold = options.pop("loss", "squared"), options.pop("threshold", 2.8)
    return folds.fit_whole_set(Candidate(find_model(name), columns, loss, threshold), weight)


@pytest.fixture(scope="module")
def fanuc():
    return prepare(shared("fanuc_r2000ic/campaign"))


def pulled(elastic, count, seed):
    return prepare(elastic_campaign(elastic, configurations=count, seed=seed))


def rigid_pulled(count, seed):
    return prepare(simulate_campaign(default_arm(), load="pull", configurations=count, seed=seed))


@pytest.fixture(scope="module")
def elastic():
    return pulled(beam_arm(default_arm()), 40, seed=3)


@pytest.mark.parametrize("name", MODELS[1:])
def test_an_estimate_is_certified_and_semidefinite(elastic, name):
    found = estimate(*elastic, name, 1e-3)
    matrices = [np.array(link.matrix) for link in found.links]
    assert (found.coupled_joints is not None) == (name == "coupled_joints")
    matrices += [] if found.coupled_joints is None else [found.coupled_joints]
    for matrix in matrices:
        np.testing.assert_array_equal(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix).min() >= 0.0
    assert (found.compliance >= 0.0).all()
    assert found.certificate.least_eigenvalue >= 0.0
    assert found.certificate.gap <= 1e-2
    assert 0.0 <= found.unexplained < 0.2
    assert 6.0 <= found.effective_freedom + 1e-6 <= found.parameters


def test_a_heavy_penalty_leaves_the_joints_alone(fanuc):
    """And those are the published least squares of the real set."""
    robot, measurements = fanuc
    found = estimate(robot, measurements, weight=10.0)
    published = [861071.8805, 2743390.9984, 2069594.5785, 359217.0978, 444155.9142, 137986.3549]
    np.testing.assert_allclose(1.0 / found.compliance, published, rtol=1e-5)
    assert found.prediction.compensation == pytest.approx(0.810339, abs=1e-5)
    assert found.effective_freedom == pytest.approx(6.0, abs=1e-6)
    assert found.scale.degrees_of_freedom == pytest.approx(3 * measurements.present.sum() - 6.0, abs=1e-6)


def test_links_that_are_known_leave_noise_and_joints_alone_leave_much_more():
    """90 fitted, 40 held out; the benchmark has 200 and 200."""
    robot, measurements = pulled(beam_arm(default_arm()), 130, seed=0)
    fitted, held_out = measurements[:90], measurements[90:]
    folds = Folds(Rows(robot, fitted), COLUMNS, VISIBLE, CrossValidation(folds=3), None)
    model = Candidate(find_model("joints_and_links"), COLUMNS)
    path = fit_folds(folds, model, (1e-6, 1e-5))
    weight = path.weights[choose_weight_index(path.errors, "best")]
    found = folds.fit_whole_set(model, weight)
    rows = rows_of(robot, held_out)
    left = np.sqrt(np.square(held_out.deflection - rows @ found.entries).mean() / 2.0) / 2e-5
    joints = fit_fold(folds, Candidate(find_model("joints"), COLUMNS), 0, (1.0,))[0][0]
    alone = np.sqrt(np.square(held_out.deflection - rows @ joints).mean() / 2.0) / 2e-5
    assert left < 1.1
    assert alone > 5.0
    spread = np.sqrt(2.0 / found.scale.degrees_of_freedom)
    assert found.scale.chi_square / found.scale.degrees_of_freedom == pytest.approx(1.0, abs=4.0 * spread)


@pytest.mark.parametrize("best", [-9.0, -6.3, -3.4, -1.6, 0.4, 0.9, 2.0])
def test_the_best_penalty_is_found_to_a_quarter_of_a_decade_wherever_it_is(monkeypatch, best):
    """Errors with a minimum within the weights that are tried first, or beyond their ends, or the limits."""

    def fitted(_folds, _model, weights):
        errors = np.tile(np.square(np.log10(weights) - best), (2, 1))
        return PenaltyPath(tuple(weights), np.tile(weights, (2, 1))[..., None], errors)

    monkeypatch.setattr(choice, "fit_folds", fitted)
    finer = refine_path(None, None, fitted(None, None, WEIGHTS))
    np.testing.assert_array_equal(finer.unknowns[1, :, 0], finer.weights)
    found = np.log10(finer.weights[choose_weight_index(finer.errors, "best")])
    assert found == pytest.approx(np.clip(best, *np.log10(LIMITS)), abs=0.126)


@pytest.mark.parametrize(
    ("name", "count", "expected", "gain"),
    [
        ("joints_and_links", 20, (1e-5, 1e-1), (1.1, 1.5)),
        ("diagonal_links", 60, (LIMITS[0], 1e-4), (1.0, 1.01)),
    ],
)
def test_few_postures_call_for_some_penalty_on_full_links_and_many_for_hardly_any(
    name, count, expected, gain
):
    """Of beams in exact balance: less penalty than the best is worse with 20 postures, and alike with 60.

    The errors held out at the least weight tried are 1.227 and 1.001 times those at the best.
    """
    robot, measurements = pulled(beam_arm(default_arm()), count, seed=1)
    model = Candidate(find_model(name), COLUMNS)
    folds = Folds(Rows(robot, measurements), COLUMNS, VISIBLE, CrossValidation(folds=2, draws=1), None)
    finer = refine_path(folds, model, fit_folds(folds, model, WEIGHTS))
    mean, best = finer.errors.mean(axis=0), choose_weight_index(finer.errors, "best")
    assert expected[0] <= finer.weights[best] <= expected[1]
    assert mean[best] <= mean[np.isin(finer.weights, WEIGHTS)].min()
    np.testing.assert_allclose(np.diff(np.log10(finer.weights))[max(0, best - 1) : best + 1], 0.25)
    assert gain[0] <= mean[0] / mean[best] < gain[1]


def test_models_with_a_base_are_compared_where_its_test_speaks():
    for asked, speaks, links, base, left_out in (
        (None, False, 1e-9, 1e-9, {*WITH_BASE}),
        ("joints_and_links", True, 1e-9, 1e-9, {*WITH_BASE}),
        ("joints_and_base", False, 0.5, 0.5, set()),
        (None, True, 1e-9, 1e-9, set()),
        (None, True, 1e-9, 0.5, {"links_and_base"}),
        (None, True, 0.5, 1e-9, {*MODELS} - {"joints", "joints_and_base"}),
        (None, True, 0.5, 0.5, {"links_and_base"}),  # each explains what the other does: both compete
    ):
        tests = SimpleNamespace(
            base_needs_validation=speaks, links_p_value_with_base=links, base_p_value_with_links=base
        )
        assert {*MODELS} - {*list_models_to_compare(tests, asked)} == left_out


def test_errors_of_many_targets_are_those_of_their_coordinates(monkeypatch):
    monkeypatch.setattr(choice, "MOST_TARGETS", 9)
    robot, measurements = rigid_pulled(6, 2)
    folds = Folds(Rows(robot, measurements), COLUMNS, VISIBLE, CrossValidation(folds=2, draws=1), None)
    compliances = np.outer([0.0, 1.0, 2.0], truth_of(beam_arm(default_arm())))
    rows = np.concatenate(
        [
            each.targets
            for each in generate_elastic_rows(Rows(robot, measurements)[folds.held_out[1]], COLUMNS)
        ]
    )
    left = rows[..., :-1] @ compliances.T - rows[..., -1:]
    expected = np.sqrt(np.square(left).mean(axis=(0, 1, 2)) / 2.0)  # of a difference of two readings
    np.testing.assert_allclose(folds.compute_prediction_errors(1, compliances), expected, rtol=1e-6)


def test_a_joint_that_a_part_sees_by_rounding_alone_is_no_unknown_of_it():
    rows = whole_rows(*rigid_pulled(6, 2))
    triangle = rows.triangle * np.where(np.arange(COLUMNS.width + 1) == 2, 1e-12, 1.0)
    form = reduce_part(replace(rows, triangle=triangle), Candidate(find_model("joints"), COLUMNS), VISIBLE)
    assert form.columns.tolist() == [0, 1, 3, 4, 5]


def selected(robot, measurements, weights, folds):
    folds = Folds(Rows(robot, measurements), COLUMNS, VISIBLE, CrossValidation(draws=1, folds=folds), None)
    models = [Candidate(find_model(name), COLUMNS) for name in MODELS]
    return select_model(folds, {model.key: fit_folds(folds, model, weights) for model in models})


STATED = {
    "load_point": (1e-6, 5e-2),
    "scale": (1e-4, 5e-2),
    "direction": (1e-6, 2e-2),
    "target_places": (1e-6, 5e-2),
    "axis_position": (1e-6, 2e-2),
    "axis_direction": (1e-6, 2e-2),
    "drift": (1e-9, 1e-4),
}
"""A small and a large standard uncertainty of each statement, in its SI unit."""


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("name", MODELS[1:])
def test_each_statement_counts_in_each_model(name, loss):
    robot, measurements = pulled(beam_arm(default_arm()), 12, seed=0)
    small = {field: uncertainties[0] for field, uncertainties in STATED.items()}
    widths = {}
    for field in ("none", *STATED):
        large = {} if field == "none" else {field: STATED[field][1]}
        common = CommonUncertainty(**(small | large))
        stated = replace(measurements, common_uncertainty=common)
        statements = Statements(list_stated_terms(stated), common, default_arm().compliances, 2e-5)
        found = estimate(robot, stated, name, 1e-2, loss=loss, statements=statements)
        ends = compute_effective_compliances(robot, found, 0.95).ends
        widths[field] = ends[:, 1] - ends[:, 0]
    for field in STATED:
        assert np.nanmax(np.abs(widths[field] / widths["none"] - 1.0)) > 1e-3, field


def test_a_load_point_off_by_what_is_stated_is_found_together_with_the_links():
    """The load acts 20 mm from where the campaign says, which it states to 20 mm."""
    arm = beam_arm(default_arm())
    robot, measurements = prepare(elastic_campaign(arm, configurations=30, seed=5))
    axes = arm.arm.axis_directions
    truth = arm.arm.compliances + np.einsum("ji,jik,jk->j", axes, arm.links[:, 3:, 3:], axes)
    off = np.array([0.02, 0.0, 0.0])
    wrong = replace(
        measurements,
        load_point=measurements.load_point + off,
        common_uncertainty=CommonUncertainty(load_point=0.02),
    )
    errors, misfit = [], []
    for terms in ((), list_stated_terms(wrong)):
        statements = Statements(terms, wrong.common_uncertainty, arm.arm.compliances, 2e-5) if terms else None
        found = estimate(robot, wrong, "joints_and_links", 3e-5, statements=statements)
        compliances = compute_effective_compliances(robot, found, 0.95)
        errors.append(np.median(np.abs(compliances.compliance / truth - 1.0)))
        misfit.append(found.scale.chi_square / found.scale.degrees_of_freedom)
    assert errors[1] < errors[0]
    assert misfit[1] < 1.3 < 1.6 < misfit[0]
    assert np.all((compliances.ends[:, 0] <= truth) & (truth <= compliances.ends[:, 1]))


def test_encoders_tell_joints_from_their_links():
    """Angles behind the gearboxes show the joint alone; targets show joint and link together."""
    arm = beam_arm(default_arm())
    robot, measurements = prepare(elastic_campaign(arm, configurations=15, seed=2))
    (block,) = regressor_blocks(robot, measurements)
    turns = block.torque * arm.arm.compliances
    noise = np.random.default_rng(0).normal(0.0, np.sqrt(2.0) * 2e-6, turns.shape)
    encoders = EncoderReadings(turns + noise, np.ones(turns.shape, dtype=bool), 2e-6)
    errors = []
    for read in (measurements, replace(measurements, encoders=encoders)):
        found = estimate(robot, read, "joints_and_links", 1e-3)
        errors.append(np.abs(found.compliance / arm.arm.compliances - 1.0).max())
    assert errors[1] < 0.05 < 0.25 < errors[0]
    assert found.prediction.encoders == pytest.approx(turns, abs=2e-5)


def test_readings_along_directions_fit_as_the_same_components_do():
    """Each target read along one of three directions across each other: three rows in place of a vector."""
    robot, measurements = pulled(beam_arm(default_arm()), 12, seed=4)
    parts = []
    for axis in np.eye(3):
        direction = np.broadcast_to(axis, measurements.deflection.shape)
        projected = measurements.deflection * direction
        parts.append(replace(measurements, direction=direction, deflection=projected))
    merged, whole = (
        Part.merge([whole_rows(robot, part) for part in parts]),
        whole_rows(robot, measurements),
    )
    assert merged.sums.readings == whole.sums.readings
    gram = whole.triangle.T @ whole.triangle
    np.testing.assert_allclose(merged.triangle.T @ merged.triangle, gram, atol=1e-12 * np.abs(gram).max())
    of_direction = estimate(robot, parts[0], "diagonal_links", 1e-2)
    assert of_direction.scale.degrees_of_freedom == pytest.approx(36.0 - of_direction.effective_freedom)


def test_a_prior_of_a_joint_holds_with_links():
    arm = beam_arm(default_arm())
    robot, measurements = prepare(elastic_campaign(arm, configurations=15, seed=2))
    stated = np.array([np.nan, arm.arm.compliances[1], *[np.nan] * 4])
    prior = Prior(stated, np.where(np.isfinite(stated), 1e-3 * stated, np.inf))
    statements = Statements((), CommonUncertainty(), np.zeros(6), 2e-5, prior)
    found = estimate(robot, measurements, "joints_and_links", 1e-3, statements=statements)
    free = estimate(robot, measurements, "joints_and_links", 1e-3)
    assert found.compliance[1] == pytest.approx(arm.arm.compliances[1], rel=5e-3)
    assert abs(free.compliance[1] / arm.arm.compliances[1] - 1.0) > 0.05


def test_selection_names_joints_where_links_are_rigid_and_links_where_they_bend(elastic):
    weights = (1e-4, 1e-2)
    assert selected(*rigid_pulled(15, 0), weights, folds=3).simplest == "joints"
    bending = selected(*elastic, weights, folds=2)
    assert bending.simplest != "joints"
    assert (
        bending.find_held_out("joints_and_links").compensation > bending.find_held_out("joints").compensation
    )
    assert bending.find_held_out("joints").penalty is None


def test_effective_compliance_about_each_axis_is_found_where_the_joint_alone_is_not():
    """Beams in exact balance; the axes are where the simulator says."""
    arm = beam_arm(default_arm())
    robot, measurements = prepare(elastic_campaign(arm, configurations=60, seed=7))
    axes = arm.arm.axis_directions
    truth = arm.arm.compliances + np.einsum("ji,jik,jk->j", axes, arm.links[:, 3:, 3:], axes)
    rows = build_effective_rows(robot, COLUMNS)
    np.testing.assert_allclose(rows @ truth_of(arm), truth, rtol=1e-9)
    estimated = estimate(robot, measurements, weight=3e-5)
    assert np.all(np.abs(rows @ estimated.entries / truth - 1.0) < 0.25)
    intervals = compute_effective_compliances(robot, estimated, 0.95)
    assert np.all(np.abs(intervals.compliance / truth - 1.0) < 0.25)
    of_given_penalty = compute_effective_compliances(robot, estimated, 0.95, publishes_ranges=False)
    np.testing.assert_array_equal(of_given_penalty.compliance, rows @ estimated.entries)
    assert np.all((intervals.ends[:, 0] <= truth) & (truth <= intervals.ends[:, 1]))
    assert np.median((intervals.ends[:, 1] - intervals.ends[:, 0]) / truth) < 1.0
    wider = compute_effective_compliances(robot, estimated, 0.99)
    assert np.all(wider.uncertainty * 2.5758 > intervals.uncertainty * 1.96)
    assert np.abs(estimated.compliance / arm.arm.compliances - 1.0).max() > 0.25


def test_squares_alone_range_as_far_as_their_ellipsoid_reaches():
    """Of an ellipsoid with half-axes 1/2 and 1/5 about (1, 2), a third parameter in no reading."""
    squares = LeastSquares(
        np.array([[2.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 0.0]]), np.array([2.0, 10.0, 0.0])
    )
    functions = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, 1.0]])
    reach = 0.1 * np.hypot(3.0 / 2.0, 4.0 / 5.0)
    expected = [[0.95, 1.05], [-2.02, -1.98], [11.0 - reach, 11.0 + reach], [np.nan, np.nan]]
    np.testing.assert_allclose(compute_unconstrained_range(squares, functions, 0.1), expected, rtol=1e-12)


def test_effective_compliance_is_the_rotation_about_an_axis_of_any_direction(elastic):
    axis, A = np.array([0.6, 0.0, 0.8]), np.random.default_rng(1).standard_normal((6, 6))
    chain = elastic[0].chain
    joints = tuple(replace(joint, axis=axis) if joint.is_moving else joint for joint in chain.joints)
    rows = build_effective_rows(Robot(replace(chain, joints=joints).model()), COLUMNS)
    for joint in range(6):
        found = rows[joint, COLUMNS.link_columns(joint)] @ to_vector(A + A.T)
        assert found == pytest.approx(axis @ (A + A.T)[3:, 3:] @ axis, rel=1e-12)


def test_squares_have_the_least_square_mean_and_huber_the_smaller_mean(fanuc):
    """A light penalty, so that the losses differ by their own terms; no sigma is stated."""
    rows, mean, rms = rows_of(*fanuc), {}, {}
    for loss in LOSSES:
        found = estimate(*fanuc, weight=1e-6, loss=loss)
        norms = np.linalg.norm(rows @ found.entries - fanuc[1].deflection, axis=-1)
        mean[loss], rms[loss] = norms.mean(), np.sqrt(np.square(norms).mean())
    assert mean["huber"] < mean["squared"]
    assert rms["squared"] < rms["huber"]


def fit_threshold(part, model, weight):
    loss, _ = fit_loss(reduce_part(part, model, VISIBLE), model, weight, gap=1e-3)
    assert isinstance(loss, HuberLoss)
    return loss.threshold


def test_residuals_that_vanish_leave_a_threshold_of_a_millionth_of_the_mean_deflection():
    """Of readings that the joints give exactly, no sigma stated."""
    robot, measurements = rigid_pulled(8, 0)
    (block,) = regressor_blocks(robot, measurements)
    exact = replace(measurements, deflection=block.A @ default_arm().compliances, sigma=None)
    model = Candidate(find_model("joints"), COLUMNS, "huber")
    threshold = fit_threshold(whole_rows(robot, exact), model, 1.0)
    mean = np.linalg.norm(exact.deflection, axis=2).mean()
    assert threshold == pytest.approx(1e-6 * model.threshold * mean / np.sqrt(2.0), rel=1e-6)  # of a reading
    noise = np.random.default_rng(0).normal(0.0, np.sqrt(2.0) * 2e-5, exact.deflection.shape)
    noisy = replace(exact, deflection=exact.deflection + noise)
    threshold = fit_threshold(whole_rows(robot, noisy), model, 1e3)
    assert threshold == pytest.approx(model.threshold * 2e-5, rel=0.25)


def test_the_squares_that_stand_for_a_robust_loss_have_its_optimum(elastic):
    robot, measurements = elastic
    wrong = measurements.deflection.copy()
    wrong[::7, 1] += [5e-4, 0.0, -5e-4]
    spoilt, model = (
        replace(measurements, deflection=wrong),
        Candidate(find_model("joints_and_links"), COLUMNS, "huber"),
    )
    robust = reduce_part(whole_rows(robot, spoilt), model, VISIBLE, spoilt.sigma)
    loss, solution = fit_loss(robust, model, 1e-3, gap=1e-8)
    compliances = robust.to_unknowns(solution)
    squares, weight = loss.build_weighted_squares(model, compliances, 1e-3)
    alike = fit_loss(squares, replace(model, loss="squared"), weight, gap=1e-6).solution
    rows = rows_of(robot, spoilt)
    moved = rows @ (squares.to_compliances(alike.x) - compliances)
    assert np.abs(moved).max() < 0.02 * measurements.sigma


def test_losses_are_compared_in_sets_of_few_targets(elastic):
    measurements = elastic[1]
    assert list_losses_to_compare(measurements, LOSSES) == LOSSES
    many = measurements[np.tile(np.arange(len(measurements)), 5)]
    assert list_losses_to_compare(many, LOSSES) == ("squared",)
    with pytest.raises(UnsupportedMethodError, match="600 targets") as refused:
        list_losses_to_compare(many, ("huber",))
    assert (refused.value.where, "squared" in refused.value.remedy) == ("loss", True)
    (finding,) = report_losses(600)
    assert finding.code == "loss_not_compared"
    assert not list(report_losses(500))


def test_folds_share_out_postures_and_keep_equal_ones_together():
    joints = np.repeat(np.arange(9.0)[:, None], 2, axis=1)[[0, 1, 2, 3, 4, 5, 6, 7, 8, 0, 3, 3]]
    folds = draw_folds(CrossValidation(folds=3, draws=1, seed=1), joints)
    assert sorted(np.concatenate(folds).tolist()) == list(range(12))
    of = {int(i): number for number, fold in enumerate(folds) for i in fold}
    assert of[0] == of[9]
    assert of[3] == of[10] == of[11]
    assert len(draw_folds(CrossValidation(folds=5, draws=2), joints[:3])) == 2 * 3
    different = draw_folds(CrossValidation(folds=3, draws=1, seed=2), joints)
    assert any(a.tolist() != b.tolist() for a, b in zip(folds, different, strict=True))
    with pytest.raises(UnsupportedMethodError, match="one posture"):
        draw_folds(CrossValidation(), joints[[0, 9]])


def test_the_rules_choose_the_best_weight_or_the_largest_that_is_as_good():
    errors = np.array([[3.0, 1.0, 1.1, 2.0], [3.0, 1.2, 1.3, 2.0], [3.0, 0.8, 0.9, 2.0]])
    assert choose_weight_index(errors, "best") == 1
    assert choose_weight_index(errors, "one_standard_error") == 2
    again = np.repeat(errors, 2, axis=0)
    assert choose_weight_index(again, "one_standard_error") == 1
    assert choose_weight_index(again, "one_standard_error", draws=2) == 2  # no more postures than before
    errors[0, 1] = np.nan
    assert choose_weight_index(errors, "best") == 2
    with pytest.raises(UnsupportedMethodError, match="no penalty") as refused:
        choose_weight_index(np.full((2, 2), np.nan), "best")
    assert refused.value.where == "link_penalty"


@pytest.mark.parametrize(
    ("weight", "loss"),
    [
        *((weight, "squared") for weight in (1e-9, 1e3)),
        *(
            pytest.param(weight, loss, marks=pytest.mark.slow)
            for weight, loss in ((1e-5, "squared"), (1e-6, "huber"), (1e3, "huber"))
        ),
    ],
)
def test_a_clean_set_is_answered_whatever_the_penalty(weight, loss):
    """Readings whose noise is 0.03 % of the deflection, where rounding counts.

    A base has a tenth of a link's penalty.
    """
    robot, measurements = prepare(shared("simulated/flexible_links_20"))
    for name in MODELS[1:]:
        least = 1e-5 if name in WITH_BASE else 0.0
        found = estimate(robot, measurements, name, max(weight, least), loss=loss)
        assert found.certificate.gap <= 1e-2
        assert found.certificate.least_eigenvalue >= 0.0


def test_a_penalty_that_cannot_be_certified_gives_way_to_the_next(elastic):
    folds = Folds(Rows(elastic[0], elastic[1][:15]), COLUMNS, VISIBLE, CrossValidation(), None)
    model = Candidate(find_model("joints_and_links"), COLUMNS)
    with pytest.raises(UnsupportedMethodError, match="certified") as refused:
        folds.fit_whole_set(model, 1e-30)
    assert (refused.value.where, "or more" in refused.value.remedy) == ("link_penalty", True)
    found = fit_first_certified(folds, model, (1e-30, 1e-4, 1e-2))
    assert found.penalty == 1e-4
    raised = report_penalty(1e-5, found.penalty)
    assert [finding.code for finding in raised] == ["link_penalty_raised"]


@pytest.mark.parametrize(("chosen", "remedy"), [(1.0, "elasticity joints"), (1e-7, "give link_penalty")])
def test_a_penalty_at_an_end_is_a_finding(chosen, remedy):
    (finding,) = report_penalty(chosen, chosen)
    assert (finding.code, finding.weight) == ("link_penalty_at_end", "use")
    assert remedy in finding.remedy
    assert not list(report_penalty(1e-2, 1e-2))


def test_a_model_without_an_answer_is_left_out_unless_it_is_asked_for(elastic):
    robot, measurements = elastic
    folds = Folds(Rows(robot, measurements), COLUMNS, VISIBLE, CrossValidation(folds=2, draws=1), None)
    paths = {
        (name, "squared"): fit_folds(folds, Candidate(find_model(name), COLUMNS), (1e-2,)) for name in MODELS
    }
    coupled = ("coupled_joints", "squared")
    paths[coupled] = replace(paths[coupled], errors=paths[coupled].errors * np.nan)
    found = select_model(folds, paths, "joints_and_links")
    answered = [name for name in MODELS if name != "coupled_joints"]
    assert [held_out.model for held_out in found.models] == answered
    with pytest.raises(UnsupportedMethodError):
        select_model(folds, paths, "coupled_joints")


def test_nothing_to_scale_the_penalty_by_is_refused(elastic):
    robot, measurements = elastic
    still = replace(measurements, deflection=np.zeros_like(measurements.deflection))
    with pytest.raises(UnsupportedMethodError, match="scale"):
        reduce_part(whole_rows(robot, still), Candidate(find_model("joints_and_links"), COLUMNS), VISIBLE)
    with pytest.raises(UnsupportedMethodError, match="13 joints"):
        Columns(13, ())


def test_predictions_hold_on_beams_at_any_place(elastic):
    """Exact beams that share no code with us, read in other postures than those fitted."""
    robot, measurements = elastic
    fitted, held_out = measurements[:25], measurements[25:]
    found = estimate(robot, fitted, weight=1e-4, shares=CrossValidation(folds=3))
    predictor = ElasticPredictor.from_estimate(robot, found)
    error = estimate_error_by_leaving_folds_out(Rows(robot, fitted), found)
    assert error.postures == 25
    configurations = Postures(robot, robot.joint_map.model_angles(held_out.joints))
    origin = configurations.to_base(np.zeros((len(held_out), 1, 3)))[:, 0]
    held, inside = [], []
    for t in range(3):
        lever = (held_out.position[:, t] - origin)[:, None]
        place = (lever @ configurations.flange_rotation)[:, 0]
        cases = LoadCases(held_out.joints, held_out.force, held_out.moment, held_out.load_point, place)
        deflection = predictor.deflect(cases)
        # The readings' own noise widens the intervals that are to hold them.
        noise = np.hypot(np.sqrt(2.0) * held_out.sigma, np.linalg.norm(deflection.covariance_root, axis=2))
        apart = np.abs(deflection.displacement - held_out.deflection[:, t])
        held.append(apart <= 1.96 * noise[:, :3])
        bound = error.bound(cases, deflection.leverage, 0.9)
        inside.append(np.linalg.norm(apart, axis=1) <= bound.radius)
    assert np.mean(held) > 0.9
    assert np.mean(inside) > 0.8
    at_load = LoadCases(held_out.joints, held_out.force, 0.0 * held_out.moment, place, place)
    same = predictor.deflect(at_load)
    moved = np.einsum("bij,bj->bi", same.compliance.matrix[:, :3, :3], held_out.force)
    np.testing.assert_allclose(moved, same.displacement, atol=1e-12)


def test_balls_hardly_grow_within_the_loads_and_in_proportion_beyond(elastic):
    """No noise is stated: it remains, with what the readings leave open. A stored model says the same."""
    robot, fitted = elastic[0], replace(elastic[1][:25], sigma=None)
    found = estimate(robot, fitted, weight=1e-4, shares=CrossValidation(folds=2))
    predictor = ElasticPredictor.from_estimate(robot, found)
    error = estimate_error_by_leaving_folds_out(Rows(robot, fitted), found)
    assert error.noise == pytest.approx(np.sqrt(2.0) * 2e-5, rel=0.3)
    cases = LoadCases(fitted.joints, fitted.force, fitted.moment, fitted.load_point, fitted.load_point)
    stored = build_stored_model(predictor, error)
    assert stored.error.noise == error.noise
    _, again = build_forward_model(predictor.robot, stored, ())
    by_load = []
    for factor in (0.25, 1.0, 4.0):
        scaled = replace(cases, force=factor * cases.force)
        leverage = predictor.deflect(scaled).leverage
        by_load.append(error.bound(scaled, leverage, 0.9).radius)
        np.testing.assert_allclose(again.bound(scaled, leverage, 0.9).radius, by_load[-1])
    assert np.all(by_load[0] <= by_load[1])
    assert np.all(by_load[0] > 0.5 * by_load[1])
    np.testing.assert_allclose(by_load[2], 4.0 * by_load[1], rtol=1e-3)


def held_out(behind):
    """Models behind a best one, None, by some paired standard errors."""
    best = np.full(16, 5e-5)
    spread = np.tile([-1.0, 1.0], 8) * np.sqrt(15 / 16) * 4e-6  # a standard error of the mean of 1e-6
    return [
        HeldOut(
            model=name,
            loss="squared",
            error=5e-5,
            penalty=None if name == "joints" else 0.1,
            by_fold=np.full(5, 0.98),
            folds_per_draw=5,
            by_posture=best if size is None else best + 1e-6 * size + spread,
        )
        for name, size in behind.items()
    ]


@pytest.mark.parametrize(("behind", "tied"), [(0.5, "diagonal_links"), (1.5, None)])
def test_links_within_a_standard_error_of_the_base_are_a_tie(behind, tied):
    models = {"joints": 9.0, "joints_and_base": None, "diagonal_links": behind, "joints_and_links": 3.0}
    chosen = Selection.choose_among(held_out(models), screened=True)
    assert (chosen.simplest, chosen.tied) == ("joints_and_base", tied)


def test_a_base_that_links_beat_is_neither_chosen_nor_tied():
    models = {"joints": 9.0, "joints_and_base": 2.0, "diagonal_links": None, "joints_and_links": 0.5}
    chosen = Selection.choose_among(held_out(models), screened=True)
    assert (chosen.simplest, chosen.tied) == ("diagonal_links", None)


def test_joined_intervals_contain_those_of_both_models():
    one = EffectiveCompliances(
        np.array([2.0, 5.0]), np.array([2.0, 5.0]), np.array([[1.0, 3.0], [4.0, 6.0]]), 2.0
    )
    other = EffectiveCompliances(
        np.array([4.0, 5.5]), np.array([4.0, 5.5]), np.array([[2.0, 5.0], [5.0, 5.8]]), 2.5
    )
    joined = one.widen_ranges_by(other)
    np.testing.assert_array_equal(joined.compliance, one.compliance)
    np.testing.assert_array_equal(joined.ends, [[1.0, 5.0], [4.0, 6.0]])
    np.testing.assert_allclose(joined.uncertainty, [1.0, 0.5])


@pytest.mark.parametrize("own", [[np.nan, np.nan], [0.0, 0.0], [2.0, 2.0]])
def test_a_joined_interval_has_its_uncertainty_whatever_this_models_is(own):
    """Unknown, or without any width: the interval is the other's, with the value of this model in it."""
    compliance = np.array([0.0 if own[0] == 0.0 else 2.0])
    one = EffectiveCompliances(compliance, compliance, np.array([own]), 2.0)
    other = EffectiveCompliances(np.array([4.0]), np.array([4.0]), np.array([[3.0, 5.0]]), 2.0)
    for joined in (one.widen_ranges_by(other), other.widen_ranges_by(one)):
        low, high = joined.ends[0]
        assert joined.uncertainty == pytest.approx([0.25 * (high - low)])
        assert low <= joined.compliance[0] <= high
        assert (low <= 3.0, high) == (True, 5.0)


def test_a_joined_interval_is_unknown_where_both_are():
    one = EffectiveCompliances(
        np.array([2.0, np.nan]), np.array([2.0, np.nan]), np.array([[np.nan, np.nan], [1.0, 3.0]]), 2.0
    )
    joined = one.widen_ranges_by(one)
    np.testing.assert_array_equal(joined.ends, one.ends)
    np.testing.assert_array_equal(joined.uncertainty, [np.nan, 0.5])


def test_a_model_at_another_penalty_is_compared_anew():
    models = held_out({"joints": 3.0, "diagonal_links": None, "joints_and_links": 1.1})
    before = Selection.choose_among(models, screened=True)
    assert (before.simplest, before.best, before.largest) == (*("diagonal_links",) * 2, "joints_and_links")
    better = replace(models[-1], by_posture=models[1].by_posture - 1e-5, penalty=1e-5)
    kept = before.replace_refined(better)
    assert (kept.simplest, kept.best, kept.largest) == (*("diagonal_links",) * 2, "joints_and_links")
    after = Selection.choose_among(kept.models, screened=True)
    assert (after.simplest, after.best, after.largest) == ("joints_and_links",) * 3
    by_huber = replace(better, loss="huber", penalty=1e-4, error=6e-5)
    assert (
        Selection.choose_among([*kept.models, by_huber], screened=True)
        .find_held_out("joints_and_links")
        .penalty
        == 1e-5
    )


@pytest.mark.parametrize(
    ("models", "chosen", "expected"),
    [
        (
            ("joints", "coupled_joints", "diagonal_links", "joints_and_links"),
            "diagonal_links",
            "joints_and_links",
        ),
        (MODELS, "diagonal_links", "links_and_base"),
        (
            ("joints", "joints_and_base", "diagonal_links", "joints_and_links"),
            "joints_and_base",
            "joints_and_base",
        ),
        (("joints", "joints_and_base"), "joints_and_base", "joints_and_base"),
    ],
)
def test_intervals_are_of_the_richest_model_that_holds_the_chosen_one(models, chosen, expected):
    assert find_richest_model(models, chosen) == expected
