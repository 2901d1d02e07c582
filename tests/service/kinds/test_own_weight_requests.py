"""The robot's own weight as users ask for it: what each joint is known by, and what it does not know."""

import numpy as np
import pytest
from support.campaigns import ARM, held
from support.documents import campaign, changed, own_weight
from support.refusals import refused, told

import jointstiff as js
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.simulator import TARGETS

SI = {"length": "m", "angle": "rad", "force": "N"}
MASSES = [{"joint": "joint_2", "mass": 10.0, "centre": [0.0, 0.0, 0.1]}]


@pytest.fixture(scope="module")
def own():
    return own_weight(30, 1)


@pytest.fixture(scope="module")
def result(own):
    return js.identify(own).result


@pytest.fixture(scope="module")
def posted(local):
    def post(document, **options):
        return local.request("POST", "/v1/campaigns", json=document | {"run": options}).json()

    return post


@pytest.fixture(scope="module")
def stored(own, posted):
    return posted(own, weight={})


def test_joints_are_known_by_readings_and_by_masses(result):
    assert result.assessment.verdict == "use"
    statuses = [joint.status for joint in result.joints]
    assert statuses == ["not_observable", *["identified"] * 5]
    assert held(result.joints[1:], ARM.compliances[1:]) == [True] * 5
    assert result.certificate.complementarity <= 1e-8
    assert len(result.residuals) == 90
    assert result.compensation == pytest.approx(0.989, abs=5e-4)
    weight = result.weight
    assert weight.joints[0].torque == pytest.approx((-0.014733, 0.0027217), rel=1e-3)
    _, second, third = weight.joints[:3]
    assert (second.torque, second.largest_sag) == (
        pytest.approx((848.05, 6273.5), rel=1e-3),
        pytest.approx(0.0020658, rel=1e-3),
    )
    assert (second.readings, second.masses) == (
        pytest.approx(0.61253, rel=1e-3),
        pytest.approx(0.38747, rel=1e-3),
    )
    assert (third.readings, third.masses) == (
        pytest.approx(0.2883, rel=1e-3),
        pytest.approx(0.7117, rel=1e-3),
    )
    assert list(weight.gravity) == pytest.approx([0.0, 0.0, -9.80665])
    assert [weight.rms_without_sag, weight.rms_residual] == pytest.approx([2.6749e-4, 2.8216e-5], rel=1e-3)


def test_bodies_may_be_the_inertials_of_a_urdf(own):
    urdf = own["robot"]["model"]["urdf"]
    for i, body in enumerate(own["robot"]["bodies"], 1):
        place = " ".join(map(repr, body["centre"]))
        inertial = f'<inertial><origin xyz="{place}"/><mass value="{body["mass"]}"/></inertial>'
        urdf = urdf.replace(f'<link name="link_{i}"/>', f'<link name="link_{i}">{inertial}</link>')
    in_urdf = changed(own["robot"], ("bodies", None), ("model.urdf", urdf))
    one, other = (prepare_robot(RobotDocument.model_validate(robot)) for robot in (own["robot"], in_urdf))
    masses = [(body.mass, body.mass_uncertainty) for body in other.document.bodies]
    assert masses == [(mass, 0.2) for mass in (380.0, 230.0, 260.0, 95.0, 55.0, 48.0)]
    assert np.allclose(
        [body.centre for body in other.robot.bodies], [body["centre"] for body in own["robot"]["bodies"]]
    )
    assert one.content_hash == other.content_hash


def test_masses_of_which_nothing_is_known_identify_no_joint(own):
    vague = [body | {"mass_uncertainty": 0.9999} for body in own["robot"]["bodies"]]
    found = js.identify(changed(own, ("robot.bodies", vague))).result
    assert {joint.status for joint in found.joints} == {"not_observable"}
    assert found.model is None
    assert (found.assessment.verdict, found.assessment.joints_identified) == ("do_not_use", 0)
    (reason,) = found.assessment.reasons
    assert (reason.code, reason.weight) == ("no_joint_identified", "do_not_use")
    assert reason.message == "the readings identify no joint: 6 not observable"
    assert reason.remedy == "read more postures, state better masses, or use a known payload"


def test_noise_that_was_refuted_is_said_with_its_factor(own):
    noise = ("measurement_set.noise", {"sigma": 1e-6, "refuted": True})
    reasons = js.identify(changed(own, noise)).result.assessment.reasons
    assert [reason.message for reason in reasons] == [
        "the stated standard uncertainty is 1 µm per coordinate of a reading, "
        "but the residuals give 28.7 µm, 28.7 times as much: deflections that the model does not explain "
        "are counted as noise"
    ]


def test_units_and_the_trackers_frame_change_no_stiffness(own, result):
    turn, shift = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, -2.0, 0.5])

    def elsewhere(observation):
        readings = [
            read | {"unloaded": (1e3 * turn.T @ (np.array(read["unloaded"]) - shift)).tolist()}
            for read in observation["readings"]
        ]
        return observation | {"joints": np.degrees(observation["joints"]).tolist(), "readings": readings}

    measured = own["measurement_set"]
    other = changed(
        own,
        ("measurement_set.units", {"length": "mm", "angle": "deg", "force": "kN"}),
        ("measurement_set.noise.sigma", 1e3 * measured["noise"]["sigma"]),
        ("measurement_set.frame", {"rotation": turn.tolist(), "translation": (1e3 * shift).tolist()}),
        ("measurement_set.observations", list(map(elsewhere, measured["observations"]))),
    )
    for joint, again in zip(result.joints[1:], js.identify(other).result.joints[1:], strict=True):
        assert again.compliance_interval == pytest.approx(joint.compliance_interval, rel=1e-4)


def test_a_deflection_beside_loaded_positions_leaves_these_as_positions():
    both = own_weight(30, 1, payload=100.0)
    first, *others = both["measurement_set"]["observations"]
    read, *rest = first["readings"]
    moved = np.subtract(read["loaded"], read["unloaded"]).tolist()
    gauge = first | {"label": "gauge", "readings": [{"target": read["target"], "deflection": moved}]}
    places = {name: list(map(float, place)) for name, place in TARGETS.items()}
    alone, found = (
        js.identify(document).result
        for document in (
            both,
            changed(
                both,
                ("measurement_set.flange_targets", places),
                ("measurement_set.observations", [first | {"readings": rest}, *others, gauge]),
            ),
        )
    )
    assert found.assessment.verdict == "use"
    assert alone.goodness.chi_square == pytest.approx(486.5, rel=1e-3)
    assert found.goodness.chi_square == pytest.approx(483.3, rel=1e-3)


class TestWhatOwnWeightDoesNotKnow:
    def test_positions_without_load_are_no_deflection(self, own):
        said = (
            "measurement_set | the set has only positions without load, which show no deflection | "
            "identify the set by the robot's own weight: give the robot's masses (`bodies`), and `weight` "
            "in the run"
        )
        assert refused(js.identify, own, weight=None) == said
        assert refused(js.compare, own) == said

    def test_a_loaded_position_alone(self, own):
        place = "measurement_set.observations.0.readings.0"
        document = changed(own, (place, {"target": "P10", "loaded": [0.0, 0.0, 0.0]}))
        where, reason, _ = refused(js.identify, document).split(" | ")
        assert where == "measurement_set.observations[0].readings[0]"
        assert reason == (
            f"1 fault; first: {where}: a reading needs `unloaded` and `loaded`, or `deflection`, or "
            "`displacement` with its direction, or (for runs with `weight`) `unloaded` alone"
        )

    def test_plans_with_a_work_area_or_gravity_that_is_estimated(self, local, own):
        robot = local.request("POST", "/v1/robots", json=own["robot"]).json()["id"]
        asked = {
            "robot_id": robot,
            "load": {"kind": "own_weight"},
            "targets": {"a": [0.1, 0.0, 0.1], "b": [0.0, 0.1, 0.1]},
            "readings": 12,
            "candidates": 40,
        }
        guess = {"stiffness": dict.fromkeys(ARM.joint_names, 1e6)}
        on_a_wall = {"kind": "own_weight", "gravity": [9.80665, 0.0, 0.0]}

        def plan(**changes):
            return local.request("POST", "/v1/plans", json=asked | changes)

        assert told(plan()) == (
            "422 | load | a plan for own weight needs the masses of the robot and the stiffness of at "
            "least one "
            "joint | state `bodies` of the robot, and a guess of the joints' `stiffness`"
        )
        area = [[1.0, 0.0, 1.0], [2.0, 1.0, 2.0]]
        assert told(plan(stiffness={"joint_2": 3e6}, work_area=area)) == (
            "422 | load | a plan for own weight supports neither a work area nor a tracker's station nor "
            "directions of gauges | omit `work_area`, `tracker` and `directions`; give the noise of the "
            "readings as `sigma`"
        )
        assert told(plan(**guess, load=on_a_wall | {"estimate_gravity": True})) == (
            "422 | load | a plan for own weight supports neither balancers nor an estimate of gravity | "
            "state `gravity` instead; for a robot with balancers, choose the postures by hand"
        )
        left_out = [plan(**guess, **load).json()["result"]["left_out"] for load in ({"load": on_a_wall}, {})]
        assert left_out == [[], ["joint_1"]]

    def test_a_map_without_a_load_unless_sag_is_asked_for(self, local, stored):
        area = {
            "run_id": stored["id"],
            "force": [0.0, 0.0, 0.0],
            "direction": [0.0, 0.0, 1.0],
            "area": [[1.4, 0.0, 1.0], [1.8, 0.0, 1.4]],
            "grid": [3, 1, 3],
            "place": [-0.06, 0.02, 0.18],
        }
        assert (
            told(local.request("POST", "/v1/maps", json=area))
            == "422 | force | the load is missing | give the force of the process in N"
        )
        made = local.request("POST", "/v1/maps", json=area | {"absolute": True}).json()
        worst = made["result"]["worst"]
        assert worst["deflection"] == pytest.approx(0.00288774, rel=1e-3)
        assert worst["readings_only"] == pytest.approx([0.00255188, 0.00322359], rel=1e-3)
        assert worst["with_model_error"] is None

    def test_sag_beside_other_masses_or_of_a_run_by_loads(self, local, stored, posted):
        loaded = posted(campaign("dead_weight"), method="partial_pose")
        still = {
            "units": SI,
            "load_point": [-0.06, 0.02, 0.18],
            "absolute": True,
            "cases": [{"joints": [0, -0.3, 0.5, 0, 0.8, 0], "force": [0, 0, 0]}],
        }
        for run, more in ((stored, {"masses": MASSES}), (loaded, {})):
            asked = still | {"run_id": run["id"]} | more
            assert told(local.request("POST", "/v1/deflections", json=asked)) == (
                f"422 | absolute | `absolute` needs a run with own weight and a request without "
                f"`masses`, but "
                f"run '{run['id']}' has no own weight, or the request has `masses` | choose "
                "a run with `weight` and without balancers, and leave "
                "`masses` out"
            )

    def test_the_trend_of_a_robot(self, local, stored):
        set_id = stored["request"]["measurement_set_id"]
        robot = local.get(f"/v1/measurement-sets/{set_id}").json()["robot_id"]
        assert local.get(f"/v1/robots/{robot}/trend").json()["left_out"] == [
            {
                "measurement_set_id": set_id,
                "name": "unloaded, 30 configurations",
                "reason": "its run uses the own weight, so an error of the masses shifts all stiffnesses",
            }
        ]
