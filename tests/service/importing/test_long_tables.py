"""Tables with a row for each posture, state and target: the column of targets is found, repeats are not."""

import pytest
from support.strange_files import JOINTS, digits, judge, names, simulate, table

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=10)
STATED = {
    "encoders": "motor", "load_point": [0, 0, 120], "force": [0, 0, -981], "units": {"force": "N"},
    "length_unit": "mm",
}  # fmt: skip
STATES = ("Sin carga", "Con carga")


def write_rows(words, positions):
    """Return a row for each posture, state and word; `positions` has those of each word in each state [m]."""
    return [
        [label, state, word, *digits(1e3 * positions[number][k][posture]), *digits(CAMPAIGN.joints[posture])]
        for posture, label in enumerate(names(CAMPAIGN))
        for k, state in enumerate(STATES)
        for number, word in enumerate(words)
    ]


def propose(header, rows, folder):
    path = folder / "largo.csv"
    path.write_text(table(["Postura", "Estado", header, *"XYZ", *JOINTS], rows), encoding="utf-8")
    return js.read(path, robot=ARM, **STATED)


def places_of(target):
    return CAMPAIGN.unloaded[:, target], CAMPAIGN.loaded[:, target]


@pytest.mark.parametrize(
    "header", ["Objetivo", "Marke", "Alvo", "Bersaglio", "мишень", "目标", "Kugel", "Which one"]
)
def test_the_column_of_targets_is_known_by_its_word_or_by_its_texts(header, tmp_path):
    rows = write_rows(["T1", "T2", "T3"], [places_of(target) for target in range(3)])
    answer = propose(header, rows, tmp_path).accept()
    assert answer.targets == ["T1", "T2", "T3"]
    assert judge(CAMPAIGN, answer.measurement_set.model_dump(mode="json")) == []


def test_texts_of_readings_at_one_place_are_no_targets(tmp_path):
    """Readings of one target by two trackers differ by 20 µm; these are no two targets."""
    first, second = places_of(0), tuple(each + 2e-5 for each in places_of(0))
    with pytest.raises(js.CampaignError) as refused:
        propose("Tracker", write_rows(["Faro", "Leica"], [first, second]), tmp_path)
    assert "'Faro' and 'Leica', which may be words for states" in str(refused.value.problem)


def test_texts_of_one_target_that_moves_by_millimetres_are_no_targets(tmp_path):
    """Two unknown words may be states: a heavy load moves a target by 5 mm in each posture."""
    positions = CAMPAIGN.unloaded[:, 0], CAMPAIGN.unloaded[:, 0] - [0.0, 0.0, 5e-3]
    rows = [
        [label, word, *digits(1e3 * positions[number][posture]), *digits(CAMPAIGN.joints[posture])]
        for posture, label in enumerate(names(CAMPAIGN))
        for number, word in enumerate(("vazio", "pesado"))
    ]
    path = tmp_path / "longo.csv"
    path.write_text(table(["Postura", "Fase", *"XYZ", *JOINTS], rows), encoding="utf-8")
    with pytest.raises(js.CampaignError) as refused:
        js.read(path, robot=ARM, **STATED)
    assert "'vazio' and 'pesado' may be words for states" in str(refused.value.problem)


def test_rows_in_different_places_are_not_called_repeats(tmp_path):
    rows = write_rows(["1", "2"], [places_of(0), places_of(1)])
    with pytest.raises(js.CampaignError) as refused:
        propose("No.", rows, tmp_path)
    text = str(refused.value.problem)
    assert "'P01' has several rows of unloaded in different places" in text
    assert "header `target`" in text
    assert "mean_of_repeats" not in text
