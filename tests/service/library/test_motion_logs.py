"""Logs as files: headers name encoders and units, and what is missing is named."""

import numpy as np
import pytest

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"


def write(path, header, times):
    """Write a log of six motors and one link, which move by their number in degrees."""
    rows = [",".join([f"{t:.6f}", *[f"{j + t}" for j in range(1, 7)], f"{2 + t}"]) for t in times]
    path.write_text("\n".join([header, *rows]))
    return path


HEADER = ",".join(["t [s]", *[f"motor_{j} [deg]" for j in range(1, 7)], "link_2 [deg]"])
TIMES = 0.004 * np.arange(600)


def test_a_log_is_read_by_the_numbers_of_its_joints(tmp_path):
    log = js.read_log(write(tmp_path / "press.csv", HEADER, TIMES), ARM)
    assert log.label == "press"
    assert log.period == 0.004
    assert list(log.motor) == [f"joint_{j}" for j in range(1, 7)]
    assert log.motor["joint_3"][0] == pytest.approx(3.0)
    assert list(log.link) == ["joint_2"]


def test_other_columns_of_a_motor_are_left_out(tmp_path):
    header = HEADER.replace("link_2 [deg]", "motor_current_1 [A]").replace("motor_6", "link_6")
    log = js.read_log(write(tmp_path / "press.csv", header, TIMES), ARM)
    assert list(log.motor) == [f"joint_{j}" for j in range(1, 6)]
    assert list(log.link) == ["joint_6"]


def test_the_unit_of_the_result_can_be_chosen(tmp_path):
    log = js.read_log(write(tmp_path / "press.csv", HEADER, TIMES), ARM, angle="rad")
    assert log.link["joint_2"][0] == pytest.approx(np.radians(2.0))


@pytest.mark.parametrize(
    ("header", "times", "words"),
    [
        (HEADER.replace("t [s]", "clock"), TIMES, "no column of times"),
        (HEADER.replace("motor_2 [deg]", "motor_9 [deg]"), TIMES, "no joint '9'"),
        (HEADER.replace("link_2 [deg]", "link_2 [grad]"), TIMES, "the unit grad"),
        (HEADER.replace("link_2 [deg]", "link_2"), TIMES, "no unit"),
        (HEADER.replace("link_2 [deg]", "torque_2"), TIMES, "no columns with angles of motors and links"),
        (HEADER, TIMES**2, "equal intervals"),
        (HEADER, TIMES[:200], "takes 0.8 s"),
        (HEADER.replace("motor_3", "motor_joint_2"), TIMES, "two columns"),
    ],
)
def test_a_log_that_is_not_understood_is_refused_with_its_place(tmp_path, header, times, words):
    with pytest.raises(js.CampaignError, match=words):
        js.read_log(write(tmp_path / "press.csv", header, times), ARM)
