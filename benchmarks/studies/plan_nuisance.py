"""Plans with elastic links as nuisance, carried out on exact beams: what their readings predict."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from benchmarks.report import Figure, Section
from jointstiff.schemas.options import CrossValidation
from jointstiff.simulator import LOAD_POINT, TARGETS, default_arm
from jointstiff.simulator.elastic_links import ElasticArm, beam_arm, elastic_deflections
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.candidates import Equipment, Loads, PlanRequest, drawn_postures
from jointstiff.solver.design.plan import plan_campaign
from jointstiff.solver.links.choice import WEIGHTS, Folds, chosen_weight, fit_folds, refined
from jointstiff.solver.links.fit import first_certified
from jointstiff.solver.links.model import ElasticColumns, ElasticModel, elastic_blocks
from jointstiff.solver.mechanics.measurements import Measurements
from tests.support.springs import robot_of

__all__ = ["run"]

_SIGMA, _FORCE = 2e-5, 1500.0
_PLACES = np.array(list(TARGETS.values()))
_COLUMNS = ElasticColumns(6, tuple(range(6)))
_MODEL = ElasticModel("joints_and_links", _COLUMNS)
_WORK_AREA = np.array([[0.5, -2.0, 0.2], [3.0, 2.0, 2.2]])
_WAYS = ("links as nuisance", "joints alone", "random", "random in the work area")


def run(*, quick: bool) -> list[Section]:
    """Plans with and without links as nuisance, and random ones, on exact beams."""
    arms = 2 if quick else 12
    errors = np.array([_Beams(seed).errors for seed in range(arms)])
    rms = np.sqrt(np.square(errors).mean(axis=0))
    best = (errors.argmin(axis=1)[:, None] == np.arange(len(_WAYS))).sum(axis=0)
    rows = [
        (way, f"{1e6 * rms[i]:.2f}", f"{1e6 * np.median(errors[:, i]):.2f}", str(best[i]))
        for i, way in enumerate(_WAYS)
    ]
    required = {"joints alone": 0.5, "random": 0.67}
    figures = [
        Figure(
            f"beams: rms of held-out predictions, planned over {way}",
            float(rms[0] / rms[_WAYS.index(way)]),
            "at most",
            most,
        )
        for way, most in required.items()
    ]
    return [
        Section(
            title=f"Exact beams, {arms} arms, 20 readings fitted by joints and links: held-out predictions",
            columns=("plan", "rms error, µm", "median arm, µm", "best on"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=("held out: 200 random postures in the work area under random pulls, exact",),
        )
    ]


def _tools() -> Equipment:
    loads = Loads("any_direction", _FORCE, np.full(6, np.inf))
    return Equipment(_PLACES, np.array(LOAD_POINT), loads, _SIGMA)


def _measurements(
    joints: FloatArray, force: FloatArray, unloaded: FloatArray, loaded: FloatArray
) -> Measurements:
    present = np.ones(unloaded.shape[:2], dtype=np.bool_)
    return Measurements(
        joints=joints,
        force=force,
        moment=np.zeros((len(joints), 3)),
        load_point=np.broadcast_to(np.array(LOAD_POINT), (len(joints), 3)),
        position=unloaded,
        in_flange=~present,
        deflection=loaded - unloaded,
        present=present,
        sigma=_SIGMA,
    )


@dataclass(frozen=True)
class _Beams:
    """One arm whose links are beams, and ways to choose readings on it."""

    seed: int

    @cached_property
    def elastic(self) -> ElasticArm:
        bending = 6e6 * 10.0 ** np.random.default_rng([self.seed, 71]).uniform(0.0, 1.0)
        return beam_arm(default_arm(), bending=bending)

    @property
    def errors(self) -> list[float]:
        """Return the root mean square errors of held-out predictions [m], in the order of the ways."""
        request = PlanRequest(
            _tools(),
            readings=20,
            nominal=self.elastic.arm.compliances,
            prior=np.full(6, np.inf),
            criterion="work_area",
            work_area=_WORK_AREA,
            candidates=2000,
            validation=0.0,
            seed=self.seed,
        )
        robot = robot_of(self.elastic.arm)
        plans = [plan_campaign(robot, replace(request, links=links)) for links in (True, False)]
        lists = [(plan.joints, plan.force) for plan in plans]
        random = [self._random(20, 75, anywhere=True), self._random(20, 72)]
        return [self._error(*each) for each in (*lists, *random)]

    def _random(self, count: int, stream: int, *, anywhere: bool = False) -> tuple[FloatArray, FloatArray]:
        """Draw postures whose load point is in the work area, or anywhere, and pulls of any direction."""
        random = np.random.default_rng([self.seed, stream])
        robot = robot_of(self.elastic.arm)
        postures = drawn_postures(robot, 20 * count, int(random.integers(2**31)))
        place = _tools().load_place(robot, postures)
        inside = ((place >= _WORK_AREA[0]) & (place <= _WORK_AREA[1])).all(axis=1) | anywhere
        pulls = random.standard_normal((count, 3))
        return postures[inside][:count], _FORCE * pulls / np.linalg.norm(pulls, axis=1, keepdims=True)

    def _read(self, joints: FloatArray, force: FloatArray, sigma: float) -> Measurements:
        points = np.broadcast_to(np.array(LOAD_POINT), (len(joints), 3))
        exact = np.stack(elastic_deflections(self.elastic, joints, force, points, _PLACES))
        noise = np.random.default_rng([self.seed, 73]).standard_normal(exact.shape)
        return _measurements(joints, force, *(exact + sigma * noise))

    def _error(self, joints: FloatArray, force: FloatArray) -> float:
        """Return the error of predictions by joints and links fitted to readings of a list [m]."""
        robot, measured = robot_of(self.elastic.arm), self._read(joints, force, _SIGMA)
        folds = Folds(robot, measured, _COLUMNS, np.ones(6, dtype=np.bool_), CrossValidation())
        path = refined(folds, _MODEL, fit_folds(folds, _MODEL, WEIGHTS))
        first = chosen_weight(path.errors, "best")
        found = first_certified(folds, _MODEL, path.weights[first:])
        held_out = self._read(*self._random(200, 74), 0.0)
        rows = [rows for _, rows in elastic_blocks(robot, held_out, _COLUMNS)]
        predicted = [part[..., :-1] @ found.entries for part in rows]
        return float(np.sqrt(np.square(np.concatenate(predicted) - held_out.deflection).sum(axis=2).mean()))
