"""Words that tell states and targets apart, in headers of any form: order never wins against them."""

import pytest
from support.strange_files import JOINTS, both, in_turn, judge, simulate, table, wide

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=14)
UNLOADED, LOADED = both(CAMPAIGN)
LOADED_FIRST = wide(CAMPAIGN, LOADED, UNLOADED)
STATED = {
    "encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -981], "units": {"force": "N"},
    "length_unit": "mm",
}  # fmt: skip


def propose(files, folder, **stated):
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return js.read(*(folder / name for name in files), robot=ARM, **(STATED | stated))


def read(files, folder, **stated):
    proposed = propose(files, folder, **stated)
    answer = proposed.accept() if hasattr(proposed, "accept") else proposed
    assert answer.missing == []
    return answer.measurement_set.model_dump(mode="json")


def list_headers(form, loaded, unloaded):
    return ["Pose", *JOINTS, *(form.format(w=word, a=axis) for word in (loaded, unloaded) for axis in "XYZ")]


@pytest.mark.parametrize(
    ("form", "loaded", "unloaded"),
    [
        ("T1.{w}.{a}", "Loaded", "Unloaded"),
        ("T1/{w}/{a}", "loaded", "unloaded"),
        ("T1:{w}:{a}", "loaded", "unloaded"),
        ("T1::{w}::{a}", "Belastet", "Unbelastet"),
        ("T1[{w}].{a}", "loaded", "unloaded"),
        ("T1.{a} ({w})", "with load", "no load"),
        ("T1{w}{a}", "Loaded", "Unloaded"),
        ("p{w}.{a}", "Loaded", "NoLoad"),
        ("T1{a}{w}", "L", ""),
        ("{w}{a}", "loaded.", "notLoaded."),
        ("T1.{a}.{w}", "F", "0"),
        ("T1.{w}.{a}", "charge", "vide"),
        ("T1.{w}.{a}", "after", "before"),
    ],
)
@pytest.mark.parametrize("force", [-981.0, 981.0])
def test_words_in_headers_of_any_form_say_the_states(form, loaded, unloaded, force, tmp_path):
    files = {"a.csv": table(list_headers(form, loaded, unloaded), LOADED_FIRST)}
    if force < 0.0:
        assert judge(CAMPAIGN, read(files, tmp_path)) == []
        return
    # A force of the wrong sign exchanges no states: it is refused, or the states are as the words say.
    try:
        taken = propose(files, tmp_path, force=[0.0, 0.0, force])
        taken = taken.accept() if hasattr(taken, "accept") else taken
    except js.CampaignError:
        return
    if taken.measurement_set is not None:
        readings = taken.measurement_set.model_dump(mode="json")["observations"][0]["readings"]
        assert readings[0]["loaded"] == pytest.approx(list(map(float, LOADED_FIRST[0][7:10])), abs=1e-3)


def test_unknown_words_are_one_question_and_the_sign_of_the_force_is_none(tmp_path):
    files = {"a.csv": table(list_headers("T1.{w}.{a}", "ba", "bb"), LOADED_FIRST)}
    with pytest.raises(js.CampaignError) as refused:
        propose(files, tmp_path)
    text = str(refused.value.problem)
    assert "'ba' as `loaded` and 'bb' as `unloaded`" in text
    assert "sign" not in text
    assert judge(CAMPAIGN, read(files, tmp_path, state_words={"ba": "loaded", "bb": "unloaded"})) == []


def test_after_next_to_before_and_loaded_is_after_unloading(tmp_path):
    words = ("before", "loaded", "after")
    rows = in_turn(CAMPAIGN, words, (UNLOADED, LOADED, UNLOADED + 1e-4))
    files = {"a.csv": table(["Pose", *JOINTS, "Step", *"XYZ"], rows)}
    for mean in (False, True):
        taken = read(files, tmp_path, mean_of_repeats=mean)
        assert judge(CAMPAIGN, taken) == []


@pytest.mark.parametrize("words", [("before", "loaded", "with"), ("before", "loaded", "charge")])
def test_rows_that_differ_by_a_word_for_a_state_have_no_mean(words, tmp_path):
    rows = in_turn(CAMPAIGN, words, (UNLOADED, LOADED, LOADED + 1e-4))
    files = {"a.csv": table(["Pose", *JOINTS, "Step", *"XYZ"], rows)}
    for mean in (False, True):
        with pytest.raises(js.CampaignError) as refused:
            propose(files, tmp_path, mean_of_repeats=mean)
        assert "which may be words for states" in str(refused.value.problem)
        assert "mean_of_repeats" not in str(refused.value.problem)


@pytest.mark.parametrize("header", ["Zyklus", "Cycle"])
def test_a_column_that_counts_postures_is_their_name_in_files_with_decimal_commas(header, tmp_path):
    joints, points = [[header, *JOINTS]], [["Punkt-ID", header, "Last", "X [mm]", "Y [mm]", "Z [mm]"]]
    for n, angles in enumerate(CAMPAIGN.joints):
        joints.append([f"{n + 1}", *(f"{angle:.3f}" for angle in angles)])
        for mass, positions in (("0", CAMPAIGN.unloaded), ("20", CAMPAIGN.loaded)):
            for k, position in enumerate(positions[n]):
                points.append([f"N{k + 1}", f"{n + 1}", mass, *(f"{1e3 * each:.3f}" for each in position)])
    files = {"punkte.csv": points, "roboter.csv": joints}
    texts = {
        name: "".join(";".join(row) + "\n" for row in rows).replace(".", ",") for name, rows in files.items()
    }
    taken = read(texts, tmp_path)["observations"]
    assert len(taken) == len(CAMPAIGN.joints)
    for n, observation in enumerate(taken):
        assert [each["target"] for each in observation["readings"]] == ["N1", "N2", "N3"]
        assert [each["loaded"] for each in observation["readings"]] == [
            pytest.approx(1e3 * position, abs=2e-3) for position in CAMPAIGN.loaded[n]
        ]


def propose_without_force(files, folder, **stated):
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    more = {name: each for name, each in STATED.items() if name not in ("force", "units")}
    return js.read(*(folder / name for name in files), robot=ARM, **(more | stated))


@pytest.mark.parametrize(
    ("unloaded", "loaded"), [("無負荷", "負荷"), ("空载", "负载"), ("vacío", "cargado"), ("frei", "belastet")]
)
def test_words_of_other_languages_say_the_states_whatever_their_order(unloaded, loaded, tmp_path):
    files = {"a.csv": table(list_headers("{a} {w}", loaded, unloaded), LOADED_FIRST)}
    sentence = str(propose_without_force(files, tmp_path))
    assert sentence.index("loaded [mm]") < sentence.index("unloaded [mm]")


@pytest.mark.parametrize(
    ("first", "second", "likely"),
    [("ref", "test", "ref"), ("full", "zero", "zero"), ("A", "B", "A"), ("F1", "F0", "F1"), ("2", "1", "2")],
)
def test_unknown_words_are_asked_with_the_likely_answer_first_without_a_force(
    first, second, likely, tmp_path
):
    files = {"a.csv": table(list_headers("{a} {w}", first, second), LOADED_FIRST)}
    with pytest.raises(js.CampaignError) as refused:
        propose_without_force(files, tmp_path)
    assert f"'{likely}' as `unloaded`" in refused.value.problem.remedy
    words = {first: "loaded", second: "unloaded"}
    sentence = str(propose_without_force(files, tmp_path, state_words=words))
    assert sentence.index("loaded [mm]") < sentence.index("unloaded [mm]")


def test_words_that_count_the_positions_need_no_question(tmp_path):
    files = {"a.csv": table(list_headers("{a} {w}", "F0", "F1"), wide(CAMPAIGN, UNLOADED, LOADED))}
    assert "T1 unloaded [mm] and 11–13 as T1 loaded" in str(propose_without_force(files, tmp_path))
