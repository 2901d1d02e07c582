"""Results of all kinds as people hold them: a line, a table, a frame, a plot, a file."""

import matplotlib as mpl
import numpy as np
import pytest
from support.guide_files import ROOT

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign, truth

mpl.use("Agg")
EXAMPLES = ROOT / "examples"
DOCUMENT = simulate_campaign(default_arm(), load="pull", configurations=12, seed=3)
AREA = np.array([[1.4, -0.2, 0.6], [1.8, 0.2, 0.6]])
POINT = (0.0, 0.0, 0.12)


@pytest.fixture(scope="module")
def run():
    return js.identify(DOCUMENT)


@pytest.fixture(scope="module")
def results(run):
    """A result of each kind, and a prediction."""
    force = np.array([0.0, 0.0, -500.0])
    return {
        "run": run,
        "comparison": js.compare(run),
        "geometry": js.geometry(EXAMPLES / "sweeps.json"),
        "plan": js.plan(run, readings=6, candidates=200),
        "map": js.map(run, area=AREA, grid=(3, 3, 1), place=(0, 0, 0.25), force=force),
        "program": js.compensate(run, EXAMPLES / "pocket.src", accuracy_option="off", force=force),
        "prediction": run.predict([[0, 0, 0, 0, 30, 0], [10, 0, 0, 0, 30, 0]], force, at=POINT),
    }


def test_each_kind_has_a_plot(results):
    for name, result in results.items():
        figure = result.plot()
        assert all(axes.has_data() for axes in figure.axes), name
        mpl.pyplot.close(figure)


def test_only_a_run_has_a_certificate(results, tmp_path):
    with pytest.raises(js.CampaignError, match="a plan has no certificate") as refused:
        results["plan"].report(tmp_path / "x.xml")
    assert refused.value.problem.remedy
    assert not (tmp_path / "x.xml").exists()


def test_a_prediction_of_arrays_is_that_of_cases_and_near_the_simulator(run):
    """Each row by itself, in other units, and against springs that balance the load."""
    q, force = (
        np.array([[0.0, -20.0, 30.0, 0.0, 45.0, 0.0], [40.0, -10.0, 5.0, 7.0, 30.0, 2.0]]),
        (0, 0, -800),
    )
    rows = run.predict(q, force, at=POINT)
    other = run.predict(np.radians(q), np.array(force) / 1e3, at=1e3 * np.array(POINT), units="mm, rad, kN")
    cases = [{"joints": row.tolist(), "force": force} for row in q]
    units = {"length": "m", "angle": "deg", "force": "N"}
    same = js.predict(run, cases, load_point=POINT, units=units)
    np.testing.assert_allclose(rows.displacement, other.displacement, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(rows.displacement, same.displacement)
    assert rows.intervals.shape == (2, 3, 2)
    assert (rows.intervals[..., 0] <= rows.displacement).all()
    with pytest.raises(js.CampaignError, match="no posture of an arm"):
        run.predict(q, force, at=POINT, units="m, rad, N")
    with pytest.raises(js.CampaignError, match="where no tool reaches"):
        run.predict(q, force, at=(0, 0, 120))


def test_the_covariance_matrix_has_the_standard_uncertainties(run):
    joints = list(run.joints.values())
    spread = np.sqrt(np.diag(run.covariance))
    np.testing.assert_allclose(spread, [joint.standard_uncertainty for joint in joints], rtol=1e-9)
    assert (np.linalg.eigvalsh(run.covariance / np.outer(spread, spread)) > 0).all()
    true = truth(default_arm(), DOCUMENT)["compliance"]
    off = np.array([joint.compliance for joint in joints]) - true
    assert off @ np.linalg.solve(run.covariance, off) < 22.5  # χ² of 6 joints at 99.9 %
