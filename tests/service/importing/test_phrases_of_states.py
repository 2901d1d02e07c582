"""Phrases of a word for a load and a word that it hangs or not, in the order of each language."""

import pytest
from support.strange_files import JOINTS, both, in_turn, judge, simulate, table, wide

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=12)
UNLOADED, LOADED = both(CAMPAIGN)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}
FORCE = {"force": [0, 0, -100], "units": {"force": "kgf"}}


def propose(content, folder, **stated):
    (folder / "a.csv").write_text(content, encoding="utf-8")
    return js.read(folder / "a.csv", robot=ARM, **STATED, **stated)


def accept(content, folder, **stated):
    proposed = propose(content, folder, **stated)
    return proposed.accept() if hasattr(proposed, "accept") else proposed


def write_wide(unloaded, loaded, form="{word} {axis} [mm]"):
    words = [form.format(word=word, axis=axis) for word in (loaded, unloaded) for axis in "XYZ"]
    return table(["Pose", *JOINTS, *words], wide(CAMPAIGN, LOADED, UNLOADED))


PHRASES = [
    ("terhelés nélkül", "terhelés alatt"), ("súly nélkül", "súllyal"), ("ilman kuormitusta", "kuormalla"),
    ("yük olmadan", "yük ile"), ("yüksüz", "yüklü"), ("無負載", "有負載"), ("无载荷", "有载荷"),
    ("無荷重", "荷重あり"), ("荷重なし", "荷重あり"), ("하중 없음", "하중 있음"), ("무하중", "유하중"),
    ("до нагрузки", "после нагрузки"),
    ("без веса", "с весом"), ("fără sarcină", "cu sarcină"), ("bez opterećenja", "pod opterećenjem"),
    ("χωρίς φορτίο", "με φορτίο"), ("keine Last", "Last"), ("vor Belastung", "nach Belastung"),
    ("przed obciążeniem", "po obciążeniu"), ("geen gewicht", "gewicht"), ("ingen last", "med lodd"),
]  # fmt: skip


UNKNOWN = ["súllyal", "после нагрузки", "nach Belastung", "po obciążeniu"]


@pytest.mark.parametrize(("unloaded", "loaded"), PHRASES)
def test_a_word_for_a_load_and_a_negation_mean_no_load(unloaded, loaded, tmp_path):
    for form in ("{word} {axis} [mm]", "tracker ({word}) {axis}"):
        answer = accept(write_wide(unloaded, loaded, form), tmp_path)
        assert answer.missing_fields == ["force"]
        meanings = [column.meaning for column in answer.files[0].columns]
        assert "unloaded" not in meanings[7]
        assert "unloaded" in meanings[10]


@pytest.mark.parametrize(("unloaded", "loaded"), [each for each in PHRASES[::2] if each[1] not in UNKNOWN])
def test_phrases_in_a_column_are_states(unloaded, loaded, tmp_path):
    rows = in_turn(CAMPAIGN, [loaded, unloaded], [LOADED, UNLOADED])
    answer = accept(table(["Pose", *JOINTS, "?", "X", "Y", "Z"], rows), tmp_path, **FORCE)
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


@pytest.mark.parametrize("unloaded", ["terhelés nélkül", "bez opterećenja", "unloaded"])
@pytest.mark.parametrize("load", ["4,5 kg", "(10 lb)"])
def test_a_load_beside_a_word_for_no_load_is_the_load_of_the_other_positions(unloaded, load, tmp_path):
    answer = accept(write_wide(unloaded, load, "tracker ({word}) {axis}"), tmp_path)
    assert answer.missing == []
    observation = answer.measurement_set.observations[0]
    mass = 4.5 if "kg" in load else 4.5359237
    assert answer.measurement_set.units.force == "kgf"
    assert observation.force == pytest.approx((0.0, 0.0, -mass))
    assert observation.readings[0].unloaded == pytest.approx(UNLOADED[0], abs=1e-3)


def test_a_load_beside_another_word_for_no_load_does_not_hang(tmp_path):
    answer = accept(write_wide("free 5 kg", "5 kg", "tracker ({word}) {axis}"), tmp_path, **FORCE)
    readings = answer.measurement_set.observations[0].readings
    assert readings[0].unloaded == pytest.approx(UNLOADED[0], abs=1e-3)


def test_the_question_for_one_word_proposes_the_state_that_the_force_shows(tmp_path):
    with pytest.raises(js.CampaignError) as refused:
        propose(write_wide("5 kg removed", "5 kg", "tracker ({word}) {axis}"), tmp_path, **FORCE)
    assert "'removed' as `unloaded`" in str(refused.value.problem)


@pytest.mark.parametrize(
    "words", [("до", "после"), ("przed obciążeniem", "po obciążeniu"), ("前", "後"), ("önce", "sonra")]
)
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_words_alone_are_a_question_that_proposes_the_likely_states(words, order, tmp_path):
    rows = in_turn(
        CAMPAIGN, [words[state] for state in order], [(UNLOADED, LOADED)[state] for state in order]
    )
    with pytest.raises(js.CampaignError) as refused:
        propose(table(["Pose", *JOINTS, "?", "X", "Y", "Z"], rows), tmp_path)
    assert f"'{words[0]}' as `unloaded` and '{words[1]}' as `loaded`" in str(refused.value.problem)
