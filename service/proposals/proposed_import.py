"""Proposal of a robot for the meaning of files, which a person accepts; or the reason without one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from jointstiff.schemas.imports import FilePreview, ImportAnswer, ImportRequest
from jointstiff.schemas.meaning import TableMeaning
from jointstiff.service.importing.errors import ImportFileError
from jointstiff.service.importing.reading import Understood, understand_files
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.proposals.names.naming import NamedReading
from jointstiff.service.resources.imports import NO_HINTS, ForceHints, import_files
from jointstiff.solver.meaning.proposal import Proposal
from jointstiff.solver.meaning.words import describe, remark
from jointstiff.solver.mechanics.robot import KnownRobot

_MOST_SKIPPED: Final = 6
"""Missing readings that a sentence names."""


@dataclass(frozen=True, eq=False)
class ProposedImport:
    """Meaning of files by the robot, and the table that is imported if a person accepts it."""

    proposal: Proposal
    named: tuple[NamedReading, ...]  # targets and states of the positions
    table: SourceFile  # with headers that the import understands
    request: ImportRequest  # options that are left for this table
    meaning: TableMeaning | None  # for a template; None without positions
    notes: tuple[str, ...] = ()  # what a person should know of rows and columns
    masses: tuple[SourceFile, ...] = ()  # files with the masses of the robot's bodies
    previews: tuple[FilePreview, ...] = ()  # of the files as they are written
    originals: tuple[SourceFile, ...] = ()  # files as they were sent
    statement: str = ""  # the proposal in words, if it has no positions that the robot could fit
    hints: ForceHints = NO_HINTS  # on the force
    moves_along_force: bool = False  # whether the targets clearly move along the force that the caller states

    @property
    def files(self) -> list[SourceFile]:
        """Files to import in place of those of the readings."""
        return [self.table, *self.masses]

    @property
    def sentence(self) -> str:
        """The proposal in words, and what a person should know about its fit, its rows and its columns."""
        if self.statement:
            return "; ".join(each for each in (self.statement, *self.notes) if each)
        text, note = describe(self.proposal, [each.words for each in self.named]), remark(self.proposal)
        return "; ".join(each for each in (text, note, *self.notes) if each)

    @property
    def text(self) -> str:
        """The proposal in words, with the question that the numbers cannot decide."""
        doubt = self.proposal.doubt
        return f"{self.sentence}. Undecided: {doubt}." if doubt else f"{self.sentence}."

    @property
    def known(self) -> KnownRobot:
        """Robot that fits."""
        return self.proposal.robots[0]

    def add_note(self, note: str) -> ProposedImport:
        """Return the proposal with a note on what the files state."""
        return replace(self, notes=(*self.notes, note))

    def find_fault(self) -> ImportFileError | None:
        """Return the first fault of the table with the proposed meaning; None if a person can accept it."""
        faults = self._understand().faults
        return faults[0] if faults else None

    def _understand(self) -> Understood:
        """Read the table with the proposed meaning."""
        return understand_files(self.files, self.request, self.known.robot.joint_names)

    def skip_missing(self) -> ProposedImport | None:
        """Return the proposal without readings that are missing or incomplete, which a note names.

        None if something else is wrong with the table, or most readings are missing.
        """
        request = self.request.model_copy(update={"allow_missing": True})
        skipping = replace(self, request=request)
        understood = skipping._understand()
        if understood.faults or len(understood.skipped) > understood.preview.reading_count:
            return None
        return replace(skipping, notes=(*self.notes, _describe_skipped(understood.skipped)))

    def accept(self, request: ImportRequest | None = None) -> ImportAnswer:
        """Import the table as the proposal says; `request` has other statements about the readings."""
        robot = self.known.robot
        answer = import_files(
            self.files,
            request or self.request,
            robot,
            originals=self.originals,
            hints=self.hints,
        )
        assumptions = [self.sentence, *answer.assumptions]
        return answer.model_copy(update={"assumptions": assumptions, "files": list(self.previews)})


def _describe_skipped(sentences: Sequence[str]) -> str:
    """Return a note on readings that are left out, which names the first of them."""
    count = len(sentences)
    counted = "1 reading is" if count == 1 else f"{count} readings are"
    others = f" and {count - _MOST_SKIPPED} more" if count > _MOST_SKIPPED else ""
    return f"{counted} missing or incomplete ({', '.join(sentences[:_MOST_SKIPPED])}{others})"


@dataclass(frozen=True)
class NoProposal:
    """Reason why no robot has a proposal for the meaning of files."""

    reason: str
    remedy: str = ""  # what to do, if the robot explains some columns and the others must be stated
    fault: ImportFileError | None = None  # that an option of the import removes, so that a person can answer

    def add_note(self, note: str) -> NoProposal:
        """Return this reason with a note on what the files state."""
        return replace(self, reason=f"{self.reason}; {note}")
