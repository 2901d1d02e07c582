"""Work of each kind that is cut into steps has the same bits in another process, as executors need."""

import io
import pickle

import numpy as np
import pytest
from support.api import posted
from support.kinds import posted_job

from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.work import QuickWork
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.mechanics import terms

RESAMPLING = {"size": 8, "repetitions": 30, "seed": 4}
CHANGES = {"run": {"resampling": RESAMPLING}}
CAUSES = {"causes": [{"name": name} for name in ("load_point", "play", "turn")]}
LINKS = {"elasticity": "joints_and_links", "cross_validation": {"folds": 3, "draws": 1}}


@pytest.fixture(scope="module")
def runs(local):
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    return [posted(local, campaign, positive=positive) for positive in (True, False)]


@pytest.fixture(
    scope="module",
    params=[*((kind.name, CHANGES.get(kind.name, {})) for kind in KINDS), ("run", LINKS), ("run", CAUSES)],
    ids=[*(kind.name for kind in KINDS), "run of links", "run with causes"],
)
def made(request, local, parts, runs):
    """Call it for the work of a kind that nobody has begun; what is done at once stays where it is."""
    (name, changes), (run, other) = request.param, runs
    job, jobs = posted_job(local, name, run, other["id"], **changes).json(), parts.jobs[name]

    def make():
        jobs.work.cache_clear()
        return jobs.work(job["id"])

    if isinstance(make(), QuickWork):
        pytest.skip("it is done at once")
    return make


@pytest.fixture
def work(made):
    return made()


class Layouts(pickle.Pickler):
    """A pickler that lists the arrays of floats whose layout it changes: BLAS sums those in another order."""

    def __init__(self):
        super().__init__(io.BytesIO())
        self.changed = []

    def persistent_id(self, value):
        if not isinstance(value, np.ndarray) or value.dtype.kind != "f":
            return
        if not (value.flags.c_contiguous or value.flags.f_contiguous):
            self.changed.append((value.shape, value.strides))


ANY_STEP = (0, 1)


def test_work_keeps_arrays_whose_layout_survives_pickling(work):
    layouts = Layouts()
    layouts.dump(work.detach_for_step(ANY_STEP))
    assert layouts.changed == []


LABELS = ["a", "b", "c"]
MADE = [terms.build_load_scale_term([{"a"}, ("b", "c")]), terms.build_turn_term(np.zeros(3))]
MADE += [terms.limit_to_later(term, LABELS, "b") for term in (*MADE, terms.SHIFT)]


@pytest.mark.parametrize("term", [*terms.TERMS.values(), *MADE], ids=lambda term: term.name)
def test_a_term_goes_to_another_process_with_the_readings(term):
    assert pickle.loads(pickle.dumps(term)).name == term.name


def test_work_that_has_computed_steps_still_pickles(work):
    """What a step compiled for the next ones is kept with the work."""
    for span in work.steps()[:2]:
        work.compute(span)
    pickle.dumps(work.detach_for_step(ANY_STEP))


def test_work_that_is_cut_into_steps_has_the_same_bits_elsewhere(work):
    for span in work.steps()[:8]:
        expected, found = (
            work.compute(span),
            pickle.loads(pickle.dumps(work.detach_for_step(span))).compute(span),
        )
        assert found.keys() == expected.keys()
        for name in expected:
            np.testing.assert_array_equal(found[name], expected[name])
    if not work.steps():
        same = pickle.loads(pickle.dumps(work.detach_for_step(ANY_STEP)))
        assert same.conclude([]).model_dump(mode="json") == work.conclude([]).model_dump(mode="json")
