"""Maps as jobs, as downloads and as a command."""

import csv
import io

import numpy as np
import pytest
from support.api import file_at, post, posted

from jointstiff.simulator import default_arm, simulate_campaign

CAMPAIGN = simulate_campaign(default_arm(), configurations=20, load="pull", seed=2)
AREA = {
    "area": [[1.2, -0.6, 0.4], [2.0, 0.6, 0.9]],
    "grid": [3, 3, 2],
    "place": [0.0, 0.0, 0.25],
    "turns": 2,
    "force": [0.0, 500.0, -800.0],
}


@pytest.fixture(scope="module")
def run_id(local):
    return posted(local, CAMPAIGN, method="partial_pose")["id"]


@pytest.fixture(scope="module")
def made(local, run_id):
    return post(local, "/v1/maps", AREA | {"run_id": run_id, "name": "plate"})


def rows_of(local, found):
    text = local.get(file_at(found, "map.csv")).text
    return list(csv.DictReader(io.StringIO(text)))


class TestDownloads:
    def test_npz_has_the_same_numbers(self, local, made):
        answer = local.get(file_at(made, "map.npz"))
        with np.load(io.BytesIO(answer.content), allow_pickle=False) as found:
            headers, table, status = list(found["headers"]), found["table"], found["status"]
            assert set(found["overall verdict"]) == {made["result"]["assessment"]["verdict"]}
        rows = rows_of(local, made)
        assert ["status", *headers, "overall verdict"] == list(rows[0])
        assert status.tolist() == [row["status"] for row in rows]
        for row, numbers in zip(rows, table, strict=True):
            read = [float(row[header] or "nan") for header in headers]
            np.testing.assert_allclose(read, numbers, rtol=1e-9)
        assert table[1, 2] != table[0, 2]  # z runs fastest


@pytest.mark.slow
def test_a_run_of_elastic_links_maps_as_it_predicts(local, run_id):
    asked = local.get(f"/v1/runs/{run_id}").json()["request"]["measurement_set_id"]
    options = {"measurement_set_id": asked, "elasticity": "joints_and_links", "link_penalty": 1e-3}
    elastic = post(local, "/v1/runs", options)["id"]
    made = post(local, "/v1/maps", AREA | {"run_id": elastic})
    assert "first order" in made["result"]["remarks"][0]
    worst = made["result"]["worst"]
    cases = [{"joints": worst["joints"], "force": AREA["force"]}]
    units = {"length": "m", "angle": "rad", "force": "N"}
    stated = {"run_id": elastic, "units": units, "load_point": AREA["place"], "cases": cases}
    case = local.request("POST", "/v1/deflections", json=stated).json()["cases"][0]
    assert worst["displacement"] == pytest.approx(case["displacement"], rel=1e-9)
    assert worst["compliance_along"] == pytest.approx(case["compliance"]["along"]["compliance"])
    radius = worst["with_model_error"][1] - worst["deflection"]
    assert radius == pytest.approx(case["with_model_error"]["radius"], rel=1e-6)
    low, high = worst["readings_only"]
    assert low < worst["deflection"] < high < worst["with_model_error"][1]
