"""Proposals whose states of load a person cannot accept: the order, a word or a force may be wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.imports import ImportRequest, State
from jointstiff.service.importing.errors import NOWHERE, ImportFileError, quote
from jointstiff.service.importing.grammar import OPPOSITE_STATE, is_likely_unloaded
from jointstiff.service.proposals.forces.naming import read_forces
from jointstiff.service.proposals.forces.turned import turn_stated_force
from jointstiff.service.proposals.names.naming import (
    NamedReading,
    find_unknown_words,
    find_words_against_order,
    list_state_words,
)
from jointstiff.service.proposals.no_proposal import NoProposalError
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.service.resources.imports import describe_turned_force
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.words import describe

_CLEARLY_FARTHER: Final = 2.0
"""Ratio of the distances to positions without and under load from which a reading is one under load."""
_LARGEST_REMAINDER: Final = 0.25
"""Largest distance of positions after unloading from those before, as a part of that from those under load,
if no name says that the load was taken off."""


def refuse_loaded_after_unloading(named: Sequence[NamedReading]) -> None:
    """Refuse positions after unloading that are not clearly nearer to those before than to those under load.

    Where names state the positions, those after unloading may be far from those before, but not farther.

    Raises:
        NoProposalError: a target has such positions: of a second load, of the same load, or nominal ones.
    """
    positions = {(each.target, each.state): each.reading.positions for each in named}
    for each in named:
        unloaded = positions.get((each.target, "unloaded"))
        loaded = positions.get((each.target, "loaded"))
        if each.state != "unloaded_after" or unloaded is None or loaded is None:
            continue
        to_loaded, to_unloaded = (
            float(np.nanmedian(np.linalg.norm(each.reading.positions - other, axis=1)))
            for other in (loaded, unloaded)
        )
        ratio = _LARGEST_REMAINDER if each.is_by_order else _CLEARLY_FARTHER
        if to_unloaded > ratio * to_loaded or _is_first_loaded(each, named):
            raise NoProposalError(
                f"the third positions of {each.target} are {1e3 * to_unloaded:.2g} mm from the first, and "
                f"{1e3 * to_loaded:.2g} mm from the second, so that headers must name the states",
                "write states or loads in the headers (`header`) or in a column, such as `X 50 kg`, or leave "
                "columns out with `ignore`, in which * is any text, such as `d*`",
            )


def _is_first_loaded(after: NamedReading, named: Sequence[NamedReading]) -> bool:
    """Return whether forces alone make the first of three positions of a target the one under load."""
    own = [each for each in named if each.target == after.target]
    states = [each.state for each in own]
    are_by_order = all(each.is_by_order for each in own)
    return are_by_order and states.index("loaded") < states.index("unloaded")


def refuse_states_against_force(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> None:
    """Refuse states by the order of positions that move against the force that the request states.

    Raises:
        NoProposalError: the first positions may be those under load, or the force has the wrong sign.
    """
    joints = find_table(tables, proposal.joints.table)
    if request.force is None or read_forces(joints) is not None:
        return
    by_order = [each for each in named if each.target in {own.target for own in named if own.is_by_order}]
    positions = {(each.target, each.state): each.reading.positions for each in by_order}
    work = 0.0
    for target in {each.target for each in by_order}:
        if (target, "unloaded") in positions and (target, "loaded") in positions:
            deflections = positions[target, "loaded"] - positions[target, "unloaded"]  # (N, 3)
            work += float(np.nansum(deflections @ np.array(request.force)))
    if work >= 0.0:
        return
    found = describe(proposal, [each.words for each in named])
    reason = f"{found}, but the targets then move against `force`"
    words = list_state_words(by_order)
    turned = turn_stated_force(proposal, named, joints, request)
    other_force = f"{describe_turned_force(turned)}; or " if turned else ""
    if words:
        other_remedy = f"{other_force}state" if other_force else ""
        raise _build_words_error(reason, words, _list_opposite_states(by_order), other_remedy)
    remedy = (
        f"{other_force}name the states in the headers (`header`) or in the names of files; or correct the "
        "sign of `force`"
    )
    raise NoProposalError(reason, remedy)


def _list_opposite_states(named: Sequence[NamedReading]) -> list[State]:
    """Return the other states of the readings of the first target that have words, in their order."""
    own = [each for each in named if each.target == named[0].target and each.contrast.words]
    return [OPPOSITE_STATE.get(each.state, "loaded") for each in own]


def refuse_order_against_words(proposal: Proposal, named: Sequence[NamedReading]) -> None:
    """Refuse states by the order of positions that words of headers, files or cells contradict.

    Raises:
        NoProposalError: a word may state another state.
    """
    words = find_words_against_order(named)
    if words:
        found = describe(proposal, [each.words for each in named])
        likely: State = "unloaded" if is_likely_unloaded(words[0]) else "loaded"
        reason = f"{found} by their order, but words may state other states"
        raise _build_words_error(reason, words, (likely, OPPOSITE_STATE[likely]))


def refuse_unknown_words(
    proposal: Proposal, named: Sequence[NamedReading], tables: Sequence[NumberTable], request: ImportRequest
) -> None:
    """Refuse states by the order of positions whose words are not known, if no force shows the states.

    Raises:
        NoProposalError: words may state other states than the order.
    """
    joints = find_table(tables, proposal.joints.table)
    is_shown_by_force = request.force is not None or read_forces(joints) is not None
    words = () if is_shown_by_force else find_unknown_words(named)
    if words:
        found = describe(proposal, [each.words for each in named])
        reason = f"{found} by their order, but the words {' and '.join(map(quote, words))} are not known"
        other = "state `force`, along which the targets move under load, or"
        raise _build_words_error(reason, words, ("unloaded", "loaded"), other)


def _build_words_error(
    reason: str, words: Sequence[str], states: Sequence[State], other_remedy: str = ""
) -> NoProposalError:
    """Return the error that words of headers, files or cells may be the states of positions.

    Args:
        reason: why the states are in doubt.
        words: words that tell the positions of a target apart.
        states: likely states of the words.
        other_remedy: what a person may state in place of the words, and `or`.
    """
    listed = " and ".join(map(quote, words))
    kind_of_words = "words for states" if len(words) > 1 else "a word for a state"
    pairs = list(zip(words, states, strict=False))
    in_order = tuple(word for word, _ in sorted(pairs, key=lambda pair: pair[1] != "unloaded"))
    examples = [f"{quote(word)} as `{state}`" for word, state in pairs]
    first = other_remedy or "state"
    remedy = f"{first} what these words mean by `state_words`, such as {' and '.join(examples)}"
    fault = ImportFileError(NOWHERE, f"{listed} may be {kind_of_words}", remedy, "state_words", in_order)
    return NoProposalError(reason, remedy, fault)
