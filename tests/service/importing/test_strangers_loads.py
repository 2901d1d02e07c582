"""Tables of strangers whose loads, states or postures are asked: the question says what to state."""

import io

import openpyxl
import pytest
from support.strange_files import JOINTS, both, simulate

import jointstiff as js

ARM = "KUKA KR 210 R2700 extra"
CAMPAIGN = simulate(ARM, seed=3, postures=14)
UNLOADED, LOADED = both(CAMPAIGN)
STATED = {"encoders": "motor", "load_point": [0, 0, 120], "length_unit": "mm"}


def propose(files, folder, **stated):
    for name, content in files.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return js.read(*(folder / name for name in files), robot=ARM, **(STATED | stated))


def write_posture_blocks(missing):
    """Return a workbook with a block for each posture; one block has no row of the target `missing`."""
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Ensaio de rigidez"])
    sheet.append([])
    for number, joints in enumerate(CAMPAIGN.joints, 1):
        sheet.append([f"POSTURA {number}"])
        sheet.append([None, *JOINTS])
        sheet.append(["Eixos (graus)", *map(float, joints)])
        sheet.append([None, "SEM CARGA", None, None, "COM CARGA"])
        sheet.append([None, *"XYZXYZ"])
        for target in (1, 2, 3):
            shift = 100.0 * (target - 1)
            positions = [*(UNLOADED[number - 1] + shift), *(LOADED[number - 1] + shift)]
            if number != 5 or target != missing:
                sheet.append([f"Alvo {target}", *map(float, positions)])
        sheet.append([])
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


@pytest.mark.parametrize("missing", [None, 2])
def test_blocks_of_postures_in_a_workbook_are_refused_with_a_remedy(missing, tmp_path):
    with pytest.raises(js.CampaignError, match="remedy: "):
        propose({"a.xlsx": write_posture_blocks(missing)}, tmp_path)
