"""`jointstiff robots`, and arms of the catalogue wherever a command needs a robot."""

from datetime import UTC, datetime
from functools import partial

import pytest
from support.terminal import terminal
from support.workbooks import table_of

from jointstiff.schemas.run import Campaign
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


run = partial(terminal, width=160)


@pytest.mark.parametrize(
    ("arm", "said"),
    [("KUKA", "several arms"), ("KR 500", "no arm 'KR 500'"), ("robot.json", "no file 'robot.json'")],
)
def test_an_unclear_arm_is_refused_with_its_remedy(folder, arm, said):
    (folder / "table.csv").write_text("J1 [deg]\n0\n")
    for command in (("import", "table.csv", "--robot", arm), ("plan", arm)):
        refused = run(*command)
        assert refused.exit_code == 2
        assert said in refused.stderr
        assert "remedy" in refused.stderr


def test_a_table_and_the_name_of_an_arm_make_a_campaign(folder):
    campaign = simulate_campaign(default_arm(), load="dead_weight", configurations=6, seed=7)
    (folder / "cell.csv").write_bytes(table_of(campaign))
    point = ",".join(repr(1e3 * part) for part in campaign["measurement_set"]["load_point"])
    options = ("--robot", "KUKA KR 210 R2700", "--encoders", "motor", "--load-point", point)
    about = ("--about", "serial_number=F-211034", "--about", "notes=load = 150 kg")
    when = ("--about", "measured_at=2026-11-20T14:30:00+01:00")
    new = (*about, *when, "--output", "new.json")
    assert run("import", "cell.csv", *options, *new).exit_code == 1, "another arm's readings: errors"
    assert not (folder / "new.json").exists()
    shown = run("import", "cell.csv", *options, *new, "--despite-errors")
    assert shown.exit_code == 0, shown.output
    written = Campaign.model_validate_json((folder / "new.json").read_text())
    assert written.robot.name == "KUKA KR 210 R2700 extra (nominal)"
    assert written.robot.joint_map is not None
    assert written.measurement_set.serial_number == "F-211034"
    assert written.measurement_set.notes == "load = 150 kg"
    assert written.measurement_set.measured_at == datetime(2026, 11, 20, 13, 30, tzinfo=UTC)
    for faulty, said in (
        ("serial=F", "serial"),
        ("measured_at=2026-11-20", "measured_at"),
        ("notes", "notes"),
    ):
        refused = run("import", "cell.csv", *options, "--about", faulty)
        assert refused.exit_code == 2
        assert f"--about.{said}" in refused.stderr
