"""Completion of a meaning that fits: names of targets and states, loads, and what the files leave open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointstiff.schemas.imports import ImportRequest
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.grammar import Vocabulary
from jointstiff.service.proposals.columns.left import list_columns_left, name_columns_left
from jointstiff.service.proposals.columns.refusals import (
    confirms_joints,
    refuse_columns_left,
    refuse_single_rows,
)
from jointstiff.service.proposals.forces.evidence import ForceEvidence
from jointstiff.service.proposals.forces.likely import describe_likely_force, refuse_force_beside_columns
from jointstiff.service.proposals.forces.naming import name_forces, note_force, take_loads, take_stated_force
from jointstiff.service.proposals.forces.stated_weights import take_stated_weight
from jointstiff.service.proposals.forces.turned import turn_stated_force
from jointstiff.service.proposals.forces.weights import describe_weights, has_masses
from jointstiff.service.proposals.found_meaning import FoundMeaning
from jointstiff.service.proposals.names.naming import NamedReading, name_readings
from jointstiff.service.proposals.no_proposal import NoProposalError
from jointstiff.service.proposals.nominal_positions import refuse_measured_nominals
from jointstiff.service.proposals.options import clear_headers, clear_names, state_units
from jointstiff.service.proposals.previews import preview_tables
from jointstiff.service.proposals.proposed_import import ProposedImport
from jointstiff.service.proposals.refusals import (
    refuse_contradiction,
    refuse_counted_targets_at_one_place,
    refuse_damaged_numbers,
    refuse_repeats_without_names,
)
from jointstiff.service.proposals.refused_states import (
    refuse_loaded_after_unloading,
    refuse_order_against_words,
    refuse_states_against_force,
    refuse_unknown_words,
)
from jointstiff.service.proposals.repeated_postures import refuse_repeated_postures
from jointstiff.service.proposals.rewriting import list_masses, note_mean_of_joints, write_readings
from jointstiff.service.proposals.tables.numbers import NumberTable, find_table
from jointstiff.service.proposals.template_meaning import build_meaning
from jointstiff.service.proposals.uncertainties import add_uncertainties
from jointstiff.service.resources.imports import ForceHints
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.words import describe


def complete(found_meaning: FoundMeaning, request: ImportRequest) -> ProposedImport:
    """Return the proposal with names of targets and states, and with the load.

    Raises:
        NoProposalError: a person must state more, or the import refuses the table with the proposed meaning.
    """
    numbers, proposal = found_meaning.numbers, found_meaning.proposal
    tables, load_notes = take_loads(proposal, numbers.tables, request)
    named = name_readings(proposal, tables, request)
    refuse_contradiction(proposal, named, tables)
    refuse_repeats_without_names(proposal, named)
    refuse_counted_targets_at_one_place(proposal, named)
    refuse_order_against_words(proposal, named)
    refuse_loaded_after_unloading(named)
    refuse_states_against_force(proposal, named, tables, request)
    tables, request, force_notes = take_stated_force(proposal, named, tables, request)
    if not force_notes:
        tables, force_notes = name_forces(proposal, named, tables, request)
    refuse_unknown_words(proposal, named, tables, request)
    if not force_notes:
        tables, force_notes = take_stated_weight(proposal, named, tables, request, numbers.files.sources)
    words = Vocabulary(request, proposal.robots[0].robot.joint_names)
    named = add_uncertainties(named, tables, words, proposal.unit)
    left = list_columns_left(proposal, tables, named)
    joints = find_table(tables, proposal.joints.table)
    notes = [*numbers.notes, *load_notes, *force_notes, *note_force(joints), *_note_uncertainties(named)]
    confirming = [each for each in left if confirms_joints(each.table, proposal, joints)]
    unread = [each for each in left if each not in confirming]
    notes += [*note_mean_of_joints(proposal, joints), *name_columns_left(unread, tables, request.state_words)]
    notes += [f"{each.table.name} has the same joints" for each in confirming]
    try:
        refuse_single_rows(proposal, tables)
        refuse_columns_left(left, proposal, named, tables)
        refuse_measured_nominals(proposal, named, tables)
        refuse_repeated_postures(proposal, named, tables, request)
        refuse_force_beside_columns(left, request, joints)
        proposed = build_import(proposal, named, tables, request, notes)
    except ImportFileError as error:
        found = describe(proposal, [each.words for each in named])
        raise NoProposalError(f"{found}, but {error.reason}", error.remedy, error) from error
    proposed = replace(
        proposed,
        hints=ForceHints(
            describe_likely_force(left), turn_stated_force(proposal, named, joints, request), request.force
        ),
        moves_along_force=_moves_along_force(proposal, named, joints, request),
    )
    fault = proposed.find_fault()
    if fault is not None and fault.option == "allow_missing" and _have_same_states(named):
        refuse_damaged_numbers(proposal, tables)
        complete = proposed.skip_missing()
        if complete is not None:
            return complete
    if fault is not None:
        are_cells_missing = fault.option == "allow_missing" and _have_same_states(named)
        is_unit_missing = (fault.option or "").startswith("units.")
        remedy = fault.remedy if are_cells_missing or is_unit_missing else ""
        reason = f"{proposed.sentence}, but the import of these columns is refused: {fault.reason}"
        raise NoProposalError(reason, remedy, fault)
    return proposed


def _moves_along_force(
    proposal: Proposal, named: Sequence[NamedReading], joints: NumberTable, request: ImportRequest
) -> bool:
    """Return whether the targets clearly move along the force that the request states, in most postures."""
    if request.force is None:
        return False
    evidence = ForceEvidence(proposal, named, joints, request)
    return evidence.count_moved_along(np.array(request.force)) is not None


def _have_same_states(named: Sequence[NamedReading]) -> bool:
    """Return whether all targets were read in the same states, so that only cells can be missing."""
    states_of_target: dict[str, set[str]] = {}
    for each in named:
        states_of_target.setdefault(each.target, set()).add(each.state)
    return len({frozenset(states) for states in states_of_target.values()}) == 1


def build_import(
    proposal: Proposal,
    named: Sequence[NamedReading],
    tables: Sequence[NumberTable],
    request: ImportRequest,
    notes: Sequence[str] = (),
) -> ProposedImport:
    """Return a proposal with the table that the import understands, and the options left for this table.

    Options about columns are left out, because the written table has headers that explain its columns.

    Args:
        proposal: meaning of the columns by the robot that fits.
        named: names of targets and states of the positions.
        tables: numbers of the files.
        request: options of the import of the files.
        notes: what a person should know of rows and columns.

    Raises:
        ImportFileError: readings under several loads have one force.
    """
    with_masses = has_masses(proposal, named, tables, request)
    table = write_readings(proposal, named, tables, with_masses=with_masses)
    options = request.model_copy(update={**clear_headers(), **clear_names(), **state_units(request)})
    meaning = build_meaning(proposal, named, tables)
    if with_masses:
        notes = (*notes, describe_weights(list_masses(named)))
    if with_masses and len(list_masses(named)) > 1:
        notes = (*notes, "each load is an observation, with the same readings without load")
    previews = tuple(preview_tables(proposal, named, tables, request.state_words))
    return ProposedImport(proposal, tuple(named), table, options, meaning, tuple(notes), previews=previews)


def _note_uncertainties(named: Sequence[NamedReading]) -> list[str]:
    """Return the note that expanded uncertainties of the positions are read, if all have one."""
    are_read = all(each.uncertainty is not None for each in named)
    return ["U95 as expanded uncertainties of the positions"] if are_read else []
