"""Tables as instruments, controllers and metrologists write them: the measured campaign, or a question."""

import pytest
from support.importing_samples import arm, sources_of
from support.strange_files import FORMS, judge, simulate

from jointstiff.schemas.imports import ImportRequest, Mapping
from jointstiff.service.imports.answer import import_files
from jointstiff.service.imports.tables import TableError

ARMS = ("KUKA KR 210 R2700 extra", "Universal Robots UR10e", "Yaskawa GP25", "FANUC M-20iD/25")
STATED = {"encoders": "motor", "load_point": (0.0, 0.0, 120.0)}
FORCE = (0.0, 0.0, -981.0)
MOST_ANSWERS = 3

ASKED = frozenset(
    (
        "a_file_in_metres_and_one_in_millimetres",
        "a_force_along_z_alone",
        "a_log_of_joint_targets",
        "a_notebook_with_titles_and_signs",
        "a_report_of_metrolog_in_lines",
        "loads_in_headers",
        "messages_of_ros_in_yaml",
        "metres_and_millimetres_without_headers",
        "names_and_values_by_colons",
        "names_and_values_in_a_line",
        "titles_between_postures",
    )
)
"""Forms for which a person states roles: numbers alone do not say what their columns mean."""


def read(name):
    """Return what becomes of a form: empty if right, else wrong numbers, a question or a refusal."""
    form = FORMS[name]
    known = arm(ARMS[list(FORMS).index(name) % len(ARMS)])
    campaign = simulate(known.name, seed=1000 + len(name), postures=14)
    sources = sources_of(*form.write(campaign).items())
    stated = STATED | ({"force": FORCE} if form.states_force else {})
    mapping = Mapping.model_validate(stated)
    try:
        answer = import_files(sources, ImportRequest(mapping=mapping), known)
        for _ in range(MOST_ANSWERS):
            question, *_ = *answer.questions, None
            if question is None:
                break
            if question.field == "force":
                mapping = answer.mapping.model_copy(update={"force": FORCE})
            elif question.choices:
                mapping = question.choices[0].mapping
            answer = import_files(sources, ImportRequest(mapping=mapping), known)
    except TableError as error:
        return f"refused: {error.reason}"
    if answer.faults or answer.measurement_set is None:
        return "asked: " + "; ".join([*answer.faults, *(each.text for each in answer.questions)])
    document = answer.measurement_set.model_dump(mode="json")
    wrong = judge(campaign, document, form.load_count)
    return f"wrong: {wrong[:3]}" if wrong else ""


@pytest.mark.parametrize("name", FORMS)
def test_a_table_is_read_right_or_asks(name):
    outcome = read(name)
    assert not outcome.startswith("wrong")
    assert (outcome == "") == (name not in ASKED), outcome
