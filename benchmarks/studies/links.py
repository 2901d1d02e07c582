"""Elastic links (method.md §7): held-out compensation, noise floor, selection, certificates, time.

The real readings are no part of this project; where they are not beside the checkout, a note says so.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import cvxpy as cp
import numpy as np

from benchmarks.campaigns import default_robot
from benchmarks.report import Figure, Part, Section, times_table
from benchmarks.studies.fanuc import CAMPAIGN, prepared
from benchmarks.timing import interleaved
from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.schemas.options import Loss
from jointstiff.simulator import default_arm
from jointstiff.simulator.campaign import simulate_positions
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_positions
from jointstiff.simulator.experiment import TARGETS, plan_experiment
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.convex.conic import entries, to_matrix, to_vector, weights
from jointstiff.solver.errors import SolverError
from jointstiff.solver.links.choice import (
    FoldFit,
    Folds,
    Plan,
    chosen_weight,
    fit_fold,
    refined,
    select_model,
)
from jointstiff.solver.links.fit import ElasticEstimate, estimate_elastic, first_certified
from jointstiff.solver.links.model import (
    LOSSES,
    MODELS,
    WITH_BASE,
    ElasticColumns,
    ElasticModel,
    ElasticRows,
    elastic_blocks,
)
from jointstiff.solver.predict.forward import LoadCases
from jointstiff.solver.predict.model_error import leave_folds_out
from jointstiff.solver.predict.models import ElasticPredictor
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.springs import BASE

__all__ = ["held_out_compensation", "random_problem", "run", "run_fanuc", "simulated"]


COLUMNS = ElasticColumns(6, tuple(range(6)))
VISIBLE = np.ones(6, dtype=np.bool_)
_MODELS = tuple(name for name in MODELS if name not in WITH_BASE)
SPLITS, FITTED = 20, 20
_CHOSEN = "joints_and_links, loss chosen"
SIGMA = 2e-5
TIMED = tuple(float(weight) for weight in np.logspace(-4.0, 0.0, 10))


def run(*, quick: bool) -> list[Section]:
    """All but what runs in parts; some minutes."""
    return [_noise_floor(quick=quick), _rigid(quick=quick), _certificates(quick=quick), _times(quick=quick)]


def run_fanuc(*, quick: bool, part: Part) -> list[Section]:
    """Real readings held out; nothing where they are not beside the checkout."""
    return [_fanuc(quick=quick, part=part)] if CAMPAIGN.is_file() else []


def _fanuc(*, quick: bool, part: Part) -> Section:
    robot, measurements = prepared(CAMPAIGN)
    candidates: dict[str, tuple[ModelName, tuple[Loss, ...]]] = {
        **{name: (name, ("squared",)) for name in _MODELS},
        **{f"joints_and_links, {loss}": ("joints_and_links", (loss,)) for loss in LOSSES[1:]},
        _CHOSEN: ("joints_and_links", LOSSES),
    }
    found: dict[str, list[float]] = {name: [] for name in candidates}
    shares, of_splits = list[FloatArray](), list[float]()
    for seed in part.of(2 if quick else SPLITS):
        drawn = np.random.default_rng(seed).permutation(len(measurements))
        parts = measurements[np.sort(drawn[:FITTED])], measurements[np.sort(drawn[FITTED:])]
        plan = Plan(seed=seed)
        folds = Folds(robot, parts[0], COLUMNS, VISIBLE, plan)
        for name, (model, losses) in candidates.items():
            compliances, elastic = _best_loss(robot, parts[0], folds, model, losses, plan)
            found[name].append(_compensation(robot, parts[1], compliances))
            if name == _CHOSEN and elastic is not None:
                shares.append(_share_of_ball(robot, parts[0], elastic, parts[1]))
                of_splits.append(1.0 / float(np.quantile(shares[-1], 0.9)))
    held = np.concatenate(shares) <= 1.0
    joints = np.array(found["joints"])
    rows = []
    for name, values in found.items():
        gain = 100 * (np.array(values) - joints)
        rows.append((name, *_mean_and_spread(100 * np.array(values)), *_mean_and_spread(gain)))
    return Section(
        title=f"FANUC R-2000iC, real readings: {len(joints)} splits, {FITTED} fitted and 10 held out",
        columns=("model", "held out, %", "deviation", "gain, points", "deviation"),
        rows=tuple(rows),
        figures=(
            Figure(
                "FANUC: held-out compensation", 100 * float(np.mean(found[_CHOSEN])), "at least", 85.2, " %"
            ),
            Figure(
                "FANUC: cross-validated, 30 poses",
                _cross_validated(robot, measurements),
                "at least",
                87,
                " %",
            ),
            Figure(
                "FANUC: ball of 90 %, radius over need, median", float(np.median(of_splits)), "at most", 1.4
            ),
            Figure("FANUC: readings within the ball of 90 %", 100 * float(held.mean()), "at least", 88, " %"),
        ),
        notes=(
            "loss and weight of the penalty are chosen within the fitted part, by five folds",
            "need: the factor of the balls' radii by which they hold 90 % of a split's held-out readings",
        ),
        data=found | {"radius over need": of_splits},
    )


def _share_of_ball(
    robot: Robot, fitted: Measurements, elastic: ElasticEstimate, held: Measurements
) -> FloatArray:
    """Return how far held-out readings are from their predictions, over the radii of the balls for 90 %."""
    error, place = leave_folds_out(robot, fitted, elastic), held.position[:, 0]  # in the flange frame
    cases = LoadCases(held.joints, held.force, held.moment, held.load_point, place.copy())
    bent = ElasticPredictor.of(robot, elastic).deflect(cases)
    off = np.linalg.norm(held.deflection[:, 0] - bent.displacement, axis=1)
    return np.asarray(off / error.bound(cases, bent.leverage, 0.9).radius)


def _cross_validated(robot: Robot, measurements: Measurements) -> float:
    """Compensation [%] of the whole set by cross-validation, joints and links, loss and penalty chosen."""
    plan = Plan()
    folds = Folds(robot, measurements, COLUMNS, VISIBLE, plan)
    models = [ElasticModel("joints_and_links", COLUMNS, loss) for loss in LOSSES]
    fits = {model.key: _fold_fits(folds, model, plan.weights) for model in models}
    selection = select_model(robot, measurements, folds, fits, plan)
    return 100 * selection.of("joints_and_links").compensation


def _best_loss(
    robot: Robot,
    measurements: Measurements,
    folds: Folds,
    name: ModelName,
    losses: Sequence[Loss],
    plan: Plan,
) -> tuple[FloatArray, ElasticEstimate | None]:
    """Compliances (P,) of a whole set under the loss and the weight that its folds choose, and the fit."""
    chosen = []
    for loss in losses:
        model = ElasticModel(name, COLUMNS, loss)
        fits = _fold_fits(folds, model, plan.weights)
        errors = np.array([fit.error for fit in fits])
        chosen.append((float(errors[:, chosen_weight(errors, plan.rule)].mean()), fits, model))
    _, fits, model = min(chosen, key=lambda each: each[0])
    if name == "joints":
        return _chosen(robot, measurements, folds, model, plan), None
    finer, fits = refined(folds, model, fits, plan)
    place = chosen_weight(np.array([fit.error for fit in fits]), plan.rule)
    elastic = first_certified(robot, measurements, folds, model, finer.weights[place:])
    return elastic.entries, elastic


def _compensation(robot: Robot, measurements: Measurements, compliances: FloatArray) -> float:
    residual, moved = [], []
    for block, rows in elastic_blocks(robot, measurements, COLUMNS):
        part = block.measurements
        left = np.linalg.norm(rows[..., -1] - rows[..., :-1] @ compliances, axis=-1)
        residual.append(left[part.present])
        moved.append(np.linalg.norm(part.deflection, axis=-1)[part.present])
    return float(1.0 - np.concatenate(residual).mean() / np.concatenate(moved).mean())


def _mean_and_spread(values: FloatArray) -> tuple[str, str]:
    return f"{values.mean():.2f}", f"{values.std(ddof=1):.2f}"


def held_out_compensation(
    robot: Robot, fitted: Measurements, held_out: Measurements, name: ModelName, *, seed: int
) -> float:
    """Compensation of readings that took part neither in the fit nor in the choice of the weight."""
    plan = Plan(seed=seed)
    folds = Folds(robot, fitted, COLUMNS, VISIBLE, plan)
    compliances, _ = _best_loss(robot, fitted, folds, name, ("squared",), plan)
    return _compensation(robot, held_out, compliances)


def _chosen(
    robot: Robot, measurements: Measurements, folds: Folds, model: ElasticModel, plan: Plan
) -> FloatArray:
    """Compliances (P,) of a whole set at the weight that its folds choose."""
    if model.name == "joints":
        problem = folds.problem(model)
        return problem.formulation.compliances(problem.joints_only())
    fits = _fold_fits(folds, model, plan.weights)
    weight = plan.weights[chosen_weight(np.array([fit.error for fit in fits]), plan.rule)]
    return estimate_elastic(robot, measurements, folds, model, weight).entries


def _fold_fits(folds: Folds, model: ElasticModel, weights: Sequence[float]) -> list[FoldFit]:
    return [fit_fold(folds, model, number, weights) for number in range(len(folds))]


def simulated(elastic: ElasticArm | None, count: int, seed: int) -> tuple[Robot, Measurements]:
    """A campaign on an arm with elastic links, or with rigid ones if None."""
    arm = default_arm() if elastic is None else elastic.arm
    experiment = plan_experiment(arm, configurations=count, load="pull", seed=seed)
    if elastic is None:
        unloaded, loaded = simulate_positions(arm, experiment, TARGETS, sigma=SIGMA, seed=seed)
    else:
        unloaded, loaded = elastic_positions(elastic, experiment, TARGETS, sigma=SIGMA, seed=seed)
    present = np.ones(unloaded.shape[:2], dtype=np.bool_)
    return default_robot(arm), Measurements(
        joints=experiment.joints,
        force=experiment.forces,
        moment=experiment.moments,
        load_point=np.array(experiment.load_points),
        position=unloaded,
        in_flange=~present,
        deflection=loaded - unloaded,
        present=present,
        sigma=SIGMA,
    )


def _noise_floor(*, quick: bool) -> Section:
    """Fit 200 configurations of an arm whose links bend, predict 200 others."""
    count = 40 if quick else 200
    robot, measurements = simulated(beam_arm(default_arm()), 2 * count, seed=0)
    fitted, held_out = measurements[:count], measurements[count:]
    plan = Plan()
    floors: dict[str, float] = {}
    folds = Folds(robot, fitted, COLUMNS, VISIBLE, plan)
    for name in _MODELS:
        compliances = _chosen(robot, fitted, folds, ElasticModel(name, COLUMNS), plan)
        blocks = elastic_blocks(robot, held_out, COLUMNS)
        residual = np.concatenate([rows[..., -1] - rows[..., :-1] @ compliances for _, rows in blocks])
        floors[name] = float(np.sqrt(np.square(residual).mean() / 2.0) / SIGMA)
    return Section(
        title=f"Simulated arm whose links bend: {count} configurations fitted, {count} held out",
        columns=("model", "held-out residual / noise"),
        rows=tuple((name, f"{floor:.3f}") for name, floor in floors.items()),
        figures=(
            Figure("links: held-out residual over noise", floors["joints_and_links"], "at most", 1.1),
            Figure("joints alone: held-out residual over noise", floors["joints"], "at least", 3.0),
        ),
        data=floors,
    )


def _rigid(*, quick: bool) -> Section:
    """Return which model is named if the links are rigid."""
    campaigns = 3 if quick else 100
    named: Counter[str] = Counter()
    for seed in range(campaigns):
        robot, measurements = simulated(None, 20, seed)
        plan = Plan(seed=seed)
        folds = Folds(robot, measurements, COLUMNS, VISIBLE, plan)
        models = [ElasticModel(name, COLUMNS) for name in _MODELS]
        fits = {model.key: _fold_fits(folds, model, plan.weights) for model in models}
        named[select_model(robot, measurements, folds, fits, plan).simplest] += 1
    share = 100 * named["joints"] / campaigns
    return Section(
        title=f"Rigid links simulated: the model that is named, {campaigns} campaigns of 20 configurations",
        columns=("model", "named"),
        rows=tuple((name, str(named[name])) for name in _MODELS),
        figures=(Figure("rigid links: selection names joints", share, "at least", 90, " %"),),
        data=dict(named),
    )


def random_problem(seed: int) -> tuple[Robot, Measurements, ElasticModel, float]:
    """Readings of the linear model with random compliances of random rank and noise of random size."""
    rng = np.random.default_rng([seed, 40])
    count, links = int(rng.integers(4, 60)), tuple(np.flatnonzero(rng.random(6) < 0.7).tolist() or [1])
    robot, measurements = simulated(None, count, seed)
    columns = ElasticColumns(6, links)
    truth = np.zeros(columns.width)
    truth[columns.joints] = 10.0 ** rng.uniform(-7.5, -5.5, 6) * (rng.random(6) < 0.9)
    for joint in links:
        half = rng.standard_normal((6, rng.integers(0, 7))) * np.repeat([1.0, 0.5], 3)[:, None]
        truth[columns.link(joint)] = 10.0 ** rng.uniform(-10.0, -6.5) * to_vector(half @ half.T)
    blocks = elastic_blocks(robot, measurements, columns)
    exact = np.concatenate([rows[..., :-1] @ truth for _, rows in blocks])
    sigma = 10.0 ** rng.uniform(-6.0, -3.5)
    readings = replace(
        measurements,
        deflection=exact + np.sqrt(2.0) * sigma * rng.standard_normal(exact.shape),
        sigma=sigma if rng.random() < 0.7 else None,
    )
    name = _MODELS[1 + int(rng.integers(0, 3))]
    return robot, readings, ElasticModel(name, columns), 10.0 ** rng.uniform(-6.0, 0.0)


def _certificates(*, quick: bool) -> Section:
    """Answer random problems, and let another solver look for anything better."""
    count, plan = 10 if quick else 500, Plan(folds=2)
    gaps, least, false, unanswered = [], [], 0, 0
    for seed in range(count):
        robot, measurements, model, weight = random_problem(seed)
        folds = Folds(robot, measurements, model.columns, VISIBLE, plan)
        try:
            estimate = estimate_elastic(robot, measurements, folds, model, weight)
        except SolverError:
            unanswered += 1
            continue
        gaps.append(estimate.certificate.gap)
        matrices = [np.array(link.matrix) for link in estimate.links]
        matrices += [] if estimate.coupled_joints is None else [estimate.coupled_joints]
        least.append(min(float(np.linalg.eigvalsh(matrix).min()) for matrix in matrices))
        false += _better_exists(Peer(folds.training(None), model), weight, estimate)
    return Section(
        title=f"Certificates: {count} random problems, and Clarabel by cvxpy on the same rows",
        columns=("answered", "unanswered", "greatest gap, sigma", "median", "least eigenvalue", "false"),
        rows=(
            (
                str(len(gaps)),
                str(unanswered),
                f"{max(gaps):.1e}",
                f"{np.median(gaps):.1e}",
                f"{min(least):.1e}",
                str(false),
            ),
        ),
        figures=(
            Figure("links: greatest gap of a certificate", max(gaps), "at most", 1e-2, " sigma"),
            Figure("links: least eigenvalue", min(least), "at least", 0.0),
            Figure("links: false certificates", false, "at most", 0),
            Figure("links: problems without an answer", unanswered, "at most", 0),
        ),
    )


class Peer:
    """The same program, stated anew in cvxpy: its own matrices, its own penalty, no compression."""

    def __init__(self, rows: ElasticRows, model: ElasticModel, stacked: FloatArray | None = None) -> None:
        """Take the sums that scale the penalty, and the rows [A d], weighted; compressed ones if None."""
        self.model = model
        stacked = rows.triangle if stacked is None else stacked
        self.size = float(np.linalg.norm(stacked[:, -1]))
        self.A, self.d = stacked[:, :-1] / self.size, stacked[:, -1] / self.size
        lever = np.sqrt(rows.lever[:BASE] / rows.configurations)
        self.lever = np.maximum(lever, 1e-2 * lever.max())
        force = np.sqrt((rows.force + rows.moment * np.mean(1.5 / self.lever**2)) / rows.configurations)
        self.softness = float(np.sqrt(rows.deflection / rows.targets) / force)

    def _metric(self, element: int | None) -> FloatArray:
        """Return the metric of the coupled joints, or of the link behind a joint."""
        squares = self.lever**2 * 2.0 / 3.0
        return np.diag(squares) if element is None else np.diag([1.0] * 3 + [squares[element]] * 3)

    @property
    def _elements(self) -> list[tuple[int | None, IndexArray]]:
        columns = self.model.columns
        if self.model.name == "coupled_joints":
            return [(None, columns.coupling)]
        return [(joint, columns.link(joint)) for joint in columns.links]

    def objective(self, compliances: FloatArray, weight: float) -> float:
        """At compliances (P,), made feasible first."""
        feasible, penalty = compliances.copy(), 0.0
        feasible[:6] = np.maximum(compliances[:6], 0.0)
        for element, own in self._elements:
            root = np.sqrt(np.diag(self._metric(element)))
            values, vectors = np.linalg.eigh(to_matrix(compliances[own], len(root)) * np.outer(root, root))
            matrix = (vectors * np.maximum(values, 0.0)) @ vectors.T
            penalty += float(np.trace(matrix)) / self.softness
            feasible[own] = to_vector(matrix / np.outer(root, root))
        return float(np.square(self.A @ feasible - self.d).sum() + weight * penalty)

    def solve(self, weight: float) -> FloatArray:
        """Compliances (P,) by a freshly stated program."""
        unit = 1.0 / np.linalg.norm(self.A[:, :6], axis=0)
        joints = cp.Variable(6, nonneg=True)
        fitted, penalty = self.A[:, :6] @ cp.multiply(unit, joints), cp.Constant(0.0)
        blocks = []
        for element, own in self._elements:
            root = np.sqrt(np.diag(self._metric(element)))
            X, constraints = self._block(len(root))
            C = cp.multiply(X, self.softness / np.outer(root, root))
            i, j = entries(len(root))
            fitted += self.A[:, own] @ cp.multiply(weights(len(root)), C[i, j])
            penalty += cp.trace(X)
            blocks.append((own, C, constraints))
        objective = cp.Minimize(cp.sum_squares(fitted - self.d) + weight * penalty)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an inaccurate answer of the peer is one more candidate
            cp.Problem(objective, [each for _, _, own in blocks for each in own]).solve(solver=cp.CLARABEL)
        out = np.zeros(self.A.shape[1])
        out[:6] = unit * joints.value
        for own, C, _ in blocks:
            out[own] = to_vector(np.asarray(C.value))
        return out

    def _block(self, size: int) -> tuple[cp.Expression, list[cp.Constraint]]:
        if self.model.name == "diagonal_links":
            values = cp.Variable(size, nonneg=True)
            return cp.diag(values), []
        return cp.Variable((size, size), PSD=True), []


def _better_exists(peer: Peer, weight: float, estimate: ElasticEstimate) -> bool:
    """Return True if another solver finds a better point than our certificate allows."""
    gap = estimate.certificate.gap * estimate.certificate.scale / peer.size
    try:
        other = peer.objective(peer.solve(weight), weight)
    except (cp.SolverError, TypeError):  # it has no answer
        return False
    return other < peer.objective(estimate.entries, weight) - gap**2 - 1e-13


def _times(*, quick: bool) -> Section:
    """A whole cross-validation: ten weights, five folds."""
    robot, measurements = simulated(beam_arm(default_arm()), 20 if quick else 50, seed=1)
    model, plan = ElasticModel("joints_and_links", COLUMNS), Plan(weights=TIMED)

    def ours() -> FloatArray:
        folds = Folds(robot, measurements, COLUMNS, VISIBLE, plan)
        return np.array([fit.error for fit in _fold_fits(folds, model, plan.weights)])

    def theirs() -> FloatArray:
        folds = Folds(robot, measurements, COLUMNS, VISIBLE, plan)
        return np.array([_stacked_errors(robot, measurements, folds, model, k) for k in range(len(folds))])

    times = interleaved(
        {"folds share triangles": ours, "fresh cvxpy": theirs}, rounds=1 if quick else 3, warm_up=0
    )
    columns, rows = times_table(times, "folds share triangles")
    ours_found, theirs_found = times.results["folds share triangles"], times.results["fresh cvxpy"]
    apart = float(np.abs(ours_found / theirs_found - 1.0).max())
    ratio = times.ratio("fresh cvxpy", "folds share triangles")
    return Section(
        title="Cross-validation, 10 weights × 5 folds, 50 configurations, six joints and six links",
        columns=columns,
        rows=rows,
        figures=(Figure("cross-validation: fresh cvxpy on stacked rows over ours", ratio, "at least", 5),),
        notes=(f"held-out residuals of the two differ by at most {apart:.1e} of themselves",),
    )


def _stacked_errors(
    robot: Robot, measurements: Measurements, folds: Folds, model: ElasticModel, fold: int
) -> list[float]:
    """Held-out errors of one fold, for all weights, by programs stated anew."""
    stacked = [_stacked(robot, measurements[indices]) for indices in folds.held_out]
    held_out = stacked.pop(fold)
    rows, peer_rows = folds.training(fold), np.concatenate(stacked)
    errors = []
    for weight in TIMED:
        found = Peer(rows, model, peer_rows).solve(weight)
        residual = (held_out[:, :-1] @ found - held_out[:, -1]).reshape(-1, 3)
        errors.append(float(np.linalg.norm(residual, axis=1).mean()))
    return errors


def _stacked(robot: Robot, measurements: Measurements) -> FloatArray:
    """Rows [A d] / √2: equal, isotropic targets."""
    blocks = [rows for _, rows in elastic_blocks(robot, measurements, COLUMNS)]
    stacked: FloatArray = np.concatenate(blocks).reshape(-1, COLUMNS.width + 1) / np.sqrt(2.0)
    return stacked
