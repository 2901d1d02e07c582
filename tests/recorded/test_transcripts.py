"""Whatever the service says in recorded sessions, it says again; the long one each night.

Record wanted changes anew:

    .venv/bin/python tests/support/transcripts.py --record
"""

import pytest
from support.transcripts import differences, rooms

SLOW = {"changes"}  # of each line and each field
ROOMS = [
    pytest.param(room, id=name, marks=[pytest.mark.slow] if name in SLOW else [])
    for name, room in rooms().items()
]


@pytest.mark.parametrize("room", ROOMS)
def test_transcript(room):
    found = list(differences(room))
    assert not found, "\n".join(found[:20])
