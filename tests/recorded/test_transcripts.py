"""Whatever the service says in recorded sessions, it says again; record wanted changes anew.

.venv/bin/python tests/support/transcripts.py --record
"""

import pytest
from support.transcripts import differences, rooms


@pytest.mark.parametrize("room", rooms().values(), ids=rooms())
def test_transcript(room):
    found = list(differences(room))
    assert not found, "\n".join(found[:20])
