"""Columns of a term are computed once for each linearisation."""

from collections import Counter

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.mechanics.block import RegressorBlock, Term


def test_a_run_computes_each_column_once(monkeypatch):
    built = Counter()
    kept = RegressorBlock.move

    def count(block: RegressorBlock, term: Term, compliance):
        before = len(block._motions)
        motion = kept(block, term, compliance)
        if len(block._motions) > before:
            balance = None if block.compliance is None else block.compliance.tobytes()
            built[term.name, compliance.tobytes(), balance, len(block.torque)] += 1
        return motion

    monkeypatch.setattr(RegressorBlock, "move", count)
    js.identify(simulate_campaign(default_arm(), load="pull", configurations=21, seed=5))
    assert built
    assert max(built.values()) == 1
