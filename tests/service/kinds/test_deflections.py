"""Deflections over HTTP and as tables, beside the balance of exact springs."""

import numpy as np
import pytest
from support.api import post, posted

import jointstiff
from jointstiff.schemas.deflection import DeflectionRequest, DeflectionResult
from jointstiff.schemas.measurement import Units
from jointstiff.schemas.robot import DhRow
from jointstiff.schemas.run import Campaign
from jointstiff.service.kinds.deflection import load_cases, read_load_cases
from jointstiff.simulator import default_arm, equilibrium, simulate_campaign
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.robot import Robot, dh_chain

ARM = default_arm()
KINDS = dict.fromkeys((f"joint_{j}" for j in range(1, 7)), "revolute")
JOINTS = [10.0, -20.0, 30.0, 5.0, 45.0, 0.0]
FORCE = [200.0, 300.0, -800.0]
POINT = [0.0, 0.0, 0.12]
HEADER = "label,J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],Fx [N],Fy [N],Fz [N]"
TABLE = f"{HEADER}\ndrill,{','.join(map(str, JOINTS + FORCE))}\n"


def run_of(client, load, **options):
    campaign = simulate_campaign(ARM, load=load, configurations=24, seed=1)
    return posted(client, campaign, **options)["id"]


def request(run_id, **changes):
    units = {"length": "mm", "angle": "deg", "force": "N"}
    case = {"label": "drill", "joints": JOINTS, "force": FORCE}
    return {"run_id": run_id, "units": units, "load_point": [0, 0, 120.0], "cases": [case]} | changes


def truth():
    q = np.radians(JOINTS)
    loaded = q + equilibrium(ARM, q, FORCE, np.zeros(3), POINT)
    before, after = (ARM.posture(angles).point_to_base(POINT) for angles in (q, loaded))
    return after - before


@pytest.fixture
def pulled(client):
    return run_of(client, "pull", complementary_stiffness="included")


def test_the_answer_holds_the_truth(client, pulled):
    answer = post(client, "/v1/deflections", request(pulled, confidence=0.95), status=200)
    result = DeflectionResult.model_validate(answer)
    (case,) = result.cases
    assert (result.model_error_postures, result.postures_needed) == (24, 19)
    assert np.linalg.norm(case.displacement - truth()) <= case.with_model_error.radius
    for k in range(3):
        low, high = case.readings_only.displacement[k]
        assert low < case.displacement[k] < high
        wide = case.with_model_error.displacement[k]
        assert wide[0] <= low
        assert high <= wide[1]
    assert case.compliance.along.lateral_free <= case.compliance.along.lateral_blocked
    assert case.compliance.symmetric
    assert result.remarks == ["own weight is not included, because no masses are given"]
    again = post(client, "/v1/deflections", request(pulled, confidence=0.95), status=200)
    assert again == answer


def test_the_budget_of_a_displacement_adds_up_and_carries_the_force(client):
    """An error of the force's scale moves every compliance, and so the displacement, in proportion."""
    campaign = simulate_campaign(ARM, load="pull", configurations=24, seed=1)
    campaign["measurement_set"]["noise"]["force"] = {"scale": 0.05}
    run_id = posted(client, campaign)["id"]
    (case,) = post(client, "/v1/deflections", request(run_id), status=200)["cases"]
    parts = {part["source"]: part for part in case["budget"]["components"]}
    assert parts["force_scale"]["contribution"] == pytest.approx(0.05 * np.linalg.norm(truth()), rel=0.02)
    assert parts["model_error"]["contribution"] * case["budget"]["coverage_factor"] == pytest.approx(
        case["with_model_error"]["radius"]
    )
    included = [part["contribution"] for part in parts.values() if part["included"]]
    assert case["budget"]["standard_uncertainty"] == pytest.approx(np.linalg.norm(included))
    assert case["budget"]["expanded_uncertainty"] == pytest.approx(1.959964 * np.linalg.norm(included))


@pytest.mark.parametrize(("factor", "said"), [(1471.0 / 1470.9975, False), (1.009, False), (1.02, True)])
def test_a_load_as_great_as_the_greatest_is_not_extrapolated(client, factor, said):
    """1471 N beside 150 kg, which weigh 1470.9975 N, is the same load; 2 % more is another."""
    campaign = simulate_campaign(ARM, load="dead_weight", configurations=24, seed=1)
    run_id = posted(client, campaign, complementary_stiffness="included")["id"]
    first = campaign["measurement_set"]["observations"][0]
    units = campaign["measurement_set"]["units"]
    greatest = max(
        (each["force"] for each in campaign["measurement_set"]["observations"]), key=np.linalg.norm
    )
    case = {"joints": first["joints"], "force": (factor * np.array(greatest)).tolist()}
    point = campaign["measurement_set"]["load_point"]
    asked = {"run_id": run_id, "units": units, "load_point": point, "cases": [case]}
    answer = post(client, "/v1/deflections", asked, status=200)
    (found,) = answer["cases"]
    assert found["with_model_error"]["load_ratio"] == pytest.approx(factor, rel=1e-9)
    assert any("the load is" in remark for remark in found["remarks"]) == said
    assert not any("is 1 times" in remark for remark in found["remarks"])
    beyond = [each for each in answer["assessment"]["reasons"] if each["code"] == "beyond_campaign"]
    assert bool(beyond) == said


def test_cases_are_bounded_by_the_joints():
    robot = Robot(dh_chain(32 * [DhRow(a=0.1, alpha=0.0, d=0.0, theta=0.0)], "standard", "snake"))
    case = {"joints": 32 * [0.0], "force": FORCE}
    largest, larger = (
        DeflectionRequest.model_validate(request("any", cases=count * [case])) for count in (146, 147)
    )
    assert len(load_cases(largest, robot).joints) == 146
    with pytest.raises(RequestError, match="147 cases for 32 joints") as caught:
        load_cases(larger, robot)
    assert caught.value.where == "cases"
    assert "at most 146" in caught.value.remedy


class TestTables:
    def test_options_and_cells_each_have_their_units(self, tmp_path):
        """Cells those of their headers, options those of `units`, which SI completes."""
        masses = [{"joint": "joint_3", "mass": 10.0, "centre": (300, 0, 0)}]
        campaign = Campaign.model_validate(simulate_campaign(ARM, load="pull", configurations=24, seed=1))
        columns = (
            ",".join(f"place {axis} [m]" for axis in "xyz")
            + ","
            + ",".join(f"M{axis} [N.m]" for axis in "xyz")
        )
        table = tmp_path / "table.csv"
        cells = TABLE.replace("Fz [N]\n", f"Fz [N],{columns}\n").replace("-800.0\n", "-800.0,0,0,0.2,0,1,0\n")
        table.write_text(cells)
        stated, si = (
            jointstiff.predict(campaign, table, **options)
            for options in (
                {
                    "load_point": (0, 0, 120),
                    "masses": masses,
                    "units": {"length": "mm", "angle": "deg", "force": "kN", "moment": "N.mm"},
                },
                {"load_point": (0, 0, 0.12), "masses": [masses[0] | {"centre": (0.3, 0, 0)}]},
            )
        )
        for case, other in zip(stated.cases, si.cases, strict=True):
            np.testing.assert_allclose(case.displacement, other.displacement, rtol=1e-12)
        short = read_load_cases(f"{cells}\n\n", KINDS, load_point=(0, 0, 120), units={"length": "mm"})
        assert short.units == Units(length="mm", angle="rad", force="N", moment="N.m")
        assert short.cases[0].place == (0.0, 0.0, 200.0)
        assert read_load_cases(cells, KINDS, units=short.units).units == short.units
