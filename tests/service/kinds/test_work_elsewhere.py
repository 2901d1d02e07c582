"""Work of each kind that is cut into steps goes to another process, as width by executors needs."""

import pickle

import numpy as np
import pytest
from support.api import posted
from support.kinds import posted_job

from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.kinds.work import QuickWork
from jointstiff.simulator import default_arm, simulate_campaign

RESAMPLING = {"size": 8, "repetitions": 30, "seed": 4}
CHANGES = {"run": {"resampling": RESAMPLING}}


@pytest.fixture(scope="module")
def runs(local):
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    return [posted(local, campaign, positive=positive) for positive in (True, False)]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_work_that_is_cut_into_steps_pickles_and_has_the_same_numbers_elsewhere(local, parts, runs, kind):
    """What is done at once stays where it was requested. The layout of arrays decides the last digits."""
    run, other = runs
    job = posted_job(local, kind.name, run, other["id"], **CHANGES.get(kind.name, {})).json()
    work = parts.jobs[kind.name].work(job["id"])
    if isinstance(work, QuickWork):
        return
    same = pickle.loads(pickle.dumps(work))
    assert same.steps() == work.steps()
    for span in work.steps():
        expected, found = work.compute(span), same.compute(span)
        assert found.keys() == expected.keys()
        for name in expected:
            np.testing.assert_allclose(found[name], expected[name], rtol=1e-12)
    if not work.steps():
        assert same.conclude([]).model_dump(mode="json") == work.conclude([]).model_dump(mode="json")
