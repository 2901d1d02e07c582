"""Command lines that are refused: each is answered with its place, the reason and a remedy."""

import json

import pytest
from support.command_lines import refused
from support.importing_samples import CAMPAIGN
from support.kinds import MAP
from support.programs import options, path, tool_poses
from support.rows import rows_of
from support.terminal import terminal

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.programs import program_text

JOINTS = ",".join(f"J{i} [deg]" for i in range(1, 7))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("refused")
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    files = {
        "pull.json": json.dumps(campaign),
        "postures.csv": f"label,{JOINTS},Fx [N],Fy [N],Fz [N]\na,0,-20,30,0,45,0,0,0,-800\n",
        "bad.csv": "label,J1 [deg]\na,1\n",
        "area.json": json.dumps(MAP),
        "path.src": program_text("krl", tool_poses(path(4)), 4),
        "options.json": json.dumps(options("krl")),
        "table.csv": CAMPAIGN,
    }
    for name, text in files.items():
        (folder / name).write_text(text)
    (folder / "run.json").write_text(terminal("identify", folder / "pull.json", "--json").stdout)
    return folder


@pytest.mark.parametrize(("line", "said"), rows_of(__file__, "refused.txt"))
def test_a_refusal_names_its_place_and_what_helps_and_writes_nothing(line, said, folder, monkeypatch):
    monkeypatch.chdir(folder)
    before = sorted(path.name for path in folder.iterdir())
    assert refused(line) == said
    assert sorted(path.name for path in folder.iterdir()) == before
