"""Files whose rows, or whose only target, have no name: nothing is asked that can be one thing only."""

import io

import numpy as np
import pytest
from support.importing_samples import answered, refusals

HEADER = "label;J1 [deg];J2 [deg];unbelastet x [mm];unbelastet y [mm];unbelastet z [mm];belastet x [mm];"
TABLE = f"{HEADER}belastet y [mm];belastet z [mm]\nc01;10;20;1;2;3;1;2;2.5\nc02;15;25;2;3;4;2;3;3.5\n"
ARRAYS = {
    "q_deg": [[10.5, 20.5], [15.0, 25.0], [20.0, 31.0]],
    "P_unl_mm": [[1.0, 2.0, 3.0], [2.0, 3.0, 4.0], [3.0, 4.0, 5.0]],
    "P_load_mm": [[1.0, 2.0, 2.5], [2.0, 3.0, 3.5], [3.0, 4.0, 4.5]],
}


def npz(**arrays):
    output = io.BytesIO()
    np.savez(output, **{name: np.array(values) for name, values in arrays.items()})
    return output.getvalue()


def test_the_only_target_without_a_name_is_t1():
    answer = answered(("KR210_stiff_2024-03-12.csv", TABLE))
    assert answer.targets == ["T1"]
    assert any("target T1 as nothing names the only target" in note for note in answer.assumptions)


def test_a_target_without_a_name_is_asked_beside_another_table_of_positions():
    said = refusals(("a_day_1.csv", TABLE), ("b_day_1.csv", TABLE.replace("c0", "d0")))
    assert any("the target is given neither by the table" in each for each in said)


@pytest.mark.process
def test_rows_of_arrays_with_joints_and_positions_need_no_names():
    answer = answered(("a.npz", npz(**ARRAYS)))
    assert answer.observation_count == len(ARRAYS["q_deg"])
    assert answer.targets == ["P"]


@pytest.mark.process
@pytest.mark.parametrize("absent", ["q_deg", "P_load_mm"])
@pytest.mark.process
def test_rows_of_arrays_without_joints_or_a_state_are_not_numbered_without_an_option(absent):
    arrays = {name: values for name, values in ARRAYS.items() if name != absent}
    if absent == "P_load_mm":
        arrays["P_mm"] = arrays.pop("P_unl_mm")
    assert any("no column names the observations" in each for each in refusals(("a.npz", npz(**arrays))))
