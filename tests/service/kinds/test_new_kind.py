"""A new kind of work: its messages, declaration, work and tables in one file; all else follows from it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from jointstiff.simulator import default_arm, simulate_campaign

CHECK = Path(__file__).parents[2] / "support" / "small_kind" / "check.py"


@pytest.mark.process
def test_one_file_is_a_kind(tmp_path):
    campaign = tmp_path / "campaign.json"
    campaign.write_text(json.dumps(simulate_campaign(default_arm(), load="pull", configurations=4, seed=1)))
    done = subprocess.run(
        [sys.executable, str(CHECK), str(campaign)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["client"] == found["route"] == found["command"] == found["python"] == 12
    assert found["csv"] == "observations,readings\r\n4,12\r\n"
    assert found["printed"].split() == ["observations,readings", "0,0"]
    assert found["deleted"] == 200
    assert all(found[name] for name in ("text", "listing", "report", "described", "filtered", "help"))
