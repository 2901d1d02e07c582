"""Mistakes in arguments of verbs: the answer names the cause, and its remedy, carried out, works."""

import re

import numpy as np
import pytest

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture(scope="module")
def document():
    return simulate_campaign(default_arm(), load="pull", configurations=8, seed=3)


@pytest.fixture(scope="module")
def run(document):
    return js.identify(document)


def refused(call, *arguments, **options):
    with pytest.raises(js.CampaignError) as answer:
        call(*arguments, **options)
    return str(answer.value)


def test_campaigns_in_a_list_are_given_one_by_one(document):
    answer = refused(js.compare, [document, document])
    assert "not `list`; remedy: give each campaign as an argument of its own, such as compare(first" in answer
    other = simulate_campaign(default_arm(), load="pull", configurations=8, seed=7)
    assert js.compare(document, other)


def test_texts_with_decimal_commas_are_named(document):
    observations = document["measurement_set"]["observations"]
    joints = [[f"{each:.6f}".replace(".", ",") for each in one["joints"]] for one in observations]
    positions = np.array([[[r["unloaded"], r["loaded"]] for r in one["readings"]] for one in observations])
    given = {
        "forces": [one["force"] for one in observations],
        "unloaded": positions[:, :, 0],
        "loaded": positions[:, :, 1],
        "load_point": document["measurement_set"]["load_point"],
        "units": "m, rad, N",
    }
    answer = refused(js.Campaign.from_arrays, document["robot"], joints, **given)
    assert (
        f"`joints` is not an array of numbers: could not convert string to float: '{joints[0][0]}'" in answer
    )
    mended = [[text.replace(",", ".") for text in row] for row in joints]
    assert js.Campaign.from_arrays(document["robot"], mended, **given)


def test_the_least_goal_is_in_percent(document):
    answer = refused(js.plan, document, goal="0.01 %")
    assert (
        "must be greater than or equal to 0.001, that is 0.1 %; remedy: give an uncertainty from 0.1 %"
        in answer
    )
    assert 'such as "15 %"' in answer
    answer = refused(js.plan, document, goal="below 5 m")
    assert 'give a limit from 0.001 µm to 1 m, such as "below 0.5 mm"' in answer


def test_a_short_grid_lacks_an_entry(run):
    box = {"area": [[1400, -200, 600], [1800, 200, 600]], "place": [0, 0, 250], "force": [0, 300, -500]}
    answer = refused(js.map, run, grid=[3, 3], **box)
    assert "grid[2]: entry 3 of the list is missing; remedy: add this entry" in answer
    assert js.map(run, grid=[3, 3, 1], **box)


def test_an_unknown_attribute_of_a_joint_is_answered_with_all(run):
    with pytest.raises(AttributeError, match=r"a JointResult has no `k`; its fields are .*stiffness, "):
        _ = run.joints["joint_2"].k
    assert not hasattr(run, "colour")


def test_joints_are_no_items_of_a_run(run):
    with pytest.raises(TypeError, match=re.escape("use `run.joints['joint_2']`")):
        run["joint_2"]
    assert run.joints["joint_2"].stiffness


def test_a_run_stands_for_its_robot_and_a_function_for_none(run):
    assert js.robot(run).model == js.robot(run.campaign).model
    assert "describes no robot" in refused(js.robot, run.predict)


def test_limits_of_stiffnesses_in_millions_are_refused(document):
    answer = refused(js.identify, document, stiffness_bounds={"joint_2": (2.1, 4.0)})
    assert "stiffness_bounds.joint_2: the stiffness of joint_2 is 4 N·m/rad" in answer
    assert "3.1 · 10⁶ N·m/rad in a table is 3.1e6" in answer
    assert js.identify(document, stiffness_bounds={"joint_2": (2.1e6, 4e6)}).result


def test_deflections_with_zeros_as_unloaded_readings_are_named(document):
    observations = document["measurement_set"]["observations"]
    places = np.array([[[r["unloaded"], r["loaded"]] for r in one["readings"]] for one in observations])
    given = {
        "joints": [one["joints"] for one in observations],
        "forces": [one["force"] for one in observations],
        "load_point": document["measurement_set"]["load_point"],
        "units": "m, rad, N",
    }
    deflections = places[:, :, 1] - places[:, :, 0]
    wrong = js.Campaign.from_arrays(
        document["robot"], unloaded=np.zeros_like(deflections), loaded=deflections, **given
    )
    reason = js.identify(wrong).result.assessment.reasons[0]
    assert "the loaded readings seem to be deflections, loaded minus unloaded" in reason.message
    assert "in arrays as `deflections`" in reason.remedy
    targets = {f"T{t}": (0.0, 0.0, 0.1) for t in range(1, deflections.shape[1] + 1)}
    assert js.Campaign.from_arrays(document["robot"], deflections=deflections, targets=targets, **given)


def test_the_address_of_a_service_has_no_version():
    with pytest.raises(js.RefusedError, match="write the address without the version"):
        js.Client("http://127.0.0.1:8000/v1")


def test_a_confidence_in_percent_is_a_fraction(document):
    assert refused(js.identify, document, confidence=95).endswith("give a fraction, such as 0.95 for 95 %")


def test_a_matrix_of_joints_and_forces_is_two_arrays(run):
    answer = refused(run.predict, np.zeros((2, 9)))
    assert re.search("`forces` are missing.*give joints and forces as two arrays", answer)


URDF = """<robot name="a"><link name="base_link"/><link name="l1"/><link name="l2"/>
<joint name="j1" type="revolute"><parent link="base_link"/><child link="l1"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize("stated", [{"flange": "tool0"}, {"base": "world", "flange": "l2"}])
def test_a_stated_link_that_does_not_exist_is_refused_at_once(stated):
    answer = refused(js.robot, URDF, **stated)
    assert re.search(r"no link '(tool0|world)' for the (flange|base) frame; remedy: use one of", answer)
    assert js.robot(URDF, base="base_link", flange="l2")


def test_an_arm_in_place_of_readings_is_named(document):
    for call in (js.identify, js.compare):
        answer = refused(call, "KUKA KR 210 R2700")
        assert "'KUKA KR 210 R2700' is an arm of the catalogue, which has no readings" in answer
        assert "`jointstiff.read(READINGS, robot='KUKA KR 210 R2700 extra')` makes of tables" in answer
    assert js.robot("KUKA KR 210 R2700 extra")


@pytest.mark.parametrize("name", ["run.json", "run.csv", "run.html", "run.mjcf"])
def test_a_missing_folder_is_named_before_anything_is_computed(run, tmp_path, name):
    folder = tmp_path / "results"
    answer = refused(run.save, folder / name)
    assert f"as there is no folder '{folder}'; remedy: make this folder first" in answer
    folder.mkdir()
    run.save(folder / name)
    assert (folder / name).is_file()


def test_a_campaign_is_saved_in_a_folder_that_exists(run, tmp_path):
    assert "there is no folder" in refused(run.campaign.save, tmp_path / "no" / "campaign.json")


@pytest.mark.parametrize("resolution", ["high", 0, -1, float("nan"), True])
def test_a_resolution_is_a_number_of_dots(run, resolution):
    with pytest.raises(ValueError, match=r"`dpi` is .*, but must be a number of dots per inch, such as 300"):
        run.plot(dpi=resolution)
    assert run.plot(dpi=300)


def test_the_load_of_a_plan_is_stated_in_the_words_of_the_terminal(document):
    stated = {"kind": "any_direction", "force": 100.0}
    plans = [js.plan(document, readings=2, load=load) for load in ("any_direction:100", stated)]
    assert plans[0].request.load == plans[1].request.load
    answer = refused(js.plan, document, readings=2, load="any direction 100")
    assert 'remedy: write the kind and the force in N, such as "any_direction:1500"' in answer


@pytest.mark.parametrize("door", ["message", "keyword"])
def test_a_characteristic_length_in_another_unit_is_refused_with_the_length_that_works(door):
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    by_length = {"method": "complete_pose", "weighting": "characteristic_length"}

    def identify(length):
        if door == "keyword":
            return js.identify(document, characteristic_length=length, **by_length)
        return js.identify(document, js.RunOptions(characteristic_length=length, **by_length))

    wrong, right = (0.25, 250) if door == "keyword" else (250, 0.25)
    with pytest.raises(js.CampaignError) as refused:
        identify(wrong)
    assert "0.25 where lengths are in m, as in messages and HTTP requests, and 250" in str(refused.value)
    assert identify(right).result.characteristic_length == pytest.approx(0.25)


@pytest.mark.parametrize("call", ["correct", "program", "map"])
def test_six_numbers_as_force_are_a_force_and_a_moment(call, tmp_path):
    run = js.identify(simulate_campaign(default_arm(), load="pull", configurations=12, seed=1))
    (tmp_path / "a.src").write_text("DEF a()\nEND\n")
    six, area = (0, 0, -800, 0, 0, 0), [[1400, -200, 600], [1800, 200, 600]]
    calls = {
        "correct": lambda: js.correct(run, [[1500, 0, 900, 0, 180, 0]], force=six, tool=[0, 0, 200, 0, 0, 0]),
        "program": lambda: js.correct(run, tmp_path / "a.src", force=six, accuracy_option="off"),
        "map": lambda: js.map(run, force=six, area=area, grid=[2, 2, 1], place=[0, 0, 250]),
    }
    with pytest.raises(js.CampaignError, match="if these are a force and a moment"):
        calls[call]()


def test_the_words_for_encoders_are_explained():
    document = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    document["measurement_set"]["encoders"] = "absolute"
    with pytest.raises(
        js.CampaignError, match=r"`motor` if .* at the motors, `secondary` if .* behind the gear"
    ):
        js.identify(document)
