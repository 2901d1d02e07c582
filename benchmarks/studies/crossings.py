"""Modules and packages that a default run goes through, and columns of terms that it computes.

The package of a module is its folder, to two levels: `schemas` of `schemas/fields.py`, `solver` of
`solver/arrays.py`, `service/kinds` of `service/kinds/run/work.py`.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from types import FrameType
from unittest.mock import patch

import jointstiff
from benchmarks.report import Section
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.block import Motion, RegressorBlock, Term

__all__ = ["run"]

_PRODUCT = ("schemas", "service", "solver")


class _Way:
    """Way of a run through modules and packages, as a profiler sees it."""

    def __init__(self) -> None:
        self.modules = Counter[str]()
        self.changes = 0
        self._package = ""

    def follow(self, frame: FrameType, event: str, _: object) -> None:
        """Note a call of a function of the product."""
        parts = Path(frame.f_code.co_filename).parts
        places = [parts.index(root) for root in _PRODUCT if event == "call" and root in parts]
        if not places:
            return
        inside = parts[min(places) :]
        folders = inside[:-1]  # the last part is the module's file
        package = "/".join(folders[:2])
        self.modules["/".join(inside)] += 1
        self.changes += package != self._package
        self._package = package


def run(*, quick: bool) -> list[Section]:  # noqa: ARG001
    """Follow a default run of one campaign, after a first run that imports everything."""
    campaign = simulate_campaign(default_arm(), load="pull", configurations=20, seed=1)
    jointstiff.identify(campaign)
    way = _Way()
    sys.setprofile(way.follow)
    try:
        jointstiff.identify(campaign)
    finally:
        sys.setprofile(None)
    built = Counter[tuple[str, bytes, bytes, int]]()
    move = RegressorBlock.move

    def count(block: RegressorBlock, term: Term, compliance: FloatArray) -> Motion:
        known = len(block._motions)
        motion = move(block, term, compliance)
        if len(block._motions) > known:
            balance = b"" if block.compliance is None else block.compliance.tobytes()
            built[term.name, compliance.tobytes(), balance, len(block.torque)] += 1
        return motion

    with patch.object(RegressorBlock, "move", count):
        jointstiff.identify(simulate_campaign(default_arm(), load="pull", configurations=20, seed=2))
    rows = (
        ("modules entered", str(len(way.modules))),
        ("changes of package", str(way.changes)),
        ("columns of terms computed", str(built.total())),
        ("different ones", str(len(built))),
    )
    return [Section(title="a default run of 20 postures", columns=("what", "count"), rows=rows)]
