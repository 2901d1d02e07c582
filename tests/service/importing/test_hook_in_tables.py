"""Tables with a target at the hook: it is read once and without load, in a row of others or of its own."""

import pytest
from support.importing_samples import sources_of

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.resources.imports import ImportRefusedError, import_files

HEADER = (
    "name;J1 [deg];Fx [N];Fy [N];Fz [N];P1 unloaded x [mm];P1 unloaded y [mm];P1 unloaded z [mm];"
    "P1 loaded x [mm];P1 loaded y [mm];P1 loaded z [mm];hook unloaded x [mm];hook unloaded y [mm];"
    "hook unloaded z [mm]"
)
PULLS = ("a;0;0;0;-500;700;0;300;700;0;299;;;", "b;20;0;0;-500;650;240;300;650;240;299;;;")


def imported(*rows, **options):
    text = "\n".join([HEADER, *rows, ""])
    stated = {"encoders": "motor", "load_point_target": "hook"} | options
    return import_files(sources_of(("a.csv", text)), ImportRequest.model_validate(stated))


def names(observation):
    return [reading.target for reading in observation.readings]


def test_a_hook_read_in_a_row_of_another_target_needs_no_other_cells():
    first, second = PULLS
    answer = imported(first, second.replace(";;;", ";600;200;100"))
    assert (answer.missing, answer.measurement_set.load_point_target) == ([], "hook")
    assert [names(each) for each in answer.measurement_set.observations] == [["P1"], ["P1", "hook"]]


def test_a_hook_read_in_a_row_of_its_own_keeps_the_targets_that_were_read_with_it():
    answer = imported("shot;0;0;0;0;700;0;300;;;;600;0;100", *PULLS)
    shot = answer.measurement_set.observations[0]
    assert names(shot) == ["P1", "hook"]
    assert {(each.loaded, each.unloaded is None) for each in shot.readings} == {(None, False)}


def test_a_hook_with_only_some_of_its_coordinates_is_a_fault():
    with pytest.raises(ImportRefusedError, match="the cell is empty, but needs a number"):
        imported(PULLS[0], PULLS[1].replace(";;;", ";600;;100"))


def test_empty_cells_of_a_target_that_is_not_at_the_hook_are_still_a_fault():
    with pytest.raises(ImportRefusedError, match="the cells of target hook are empty"):
        imported(*PULLS, PULLS[0].replace("a;", "c;").replace(";;;", ";1;2;3"), load_point_target="P1")
