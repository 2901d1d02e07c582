"""Errors that forbid a proposal of the meaning of files."""

from __future__ import annotations

from jointstiff.service.importing.errors import ImportFileError


class NoProposalError(Exception):
    """Error that no robot has a proposal for the meaning of files; `propose_import` answers its reason."""

    def __init__(self, reason: str, remedy: str = "", fault: ImportFileError | None = None) -> None:
        super().__init__(reason)
        self.reason = reason  # why there is no proposal, in words
        self.remedy = remedy  # what to do, if columns must be stated
        self.fault = fault if fault is not None and fault.option is not None else None


class UnfinishedError(NoProposalError):
    """Error that the robot explains columns of files, but that a person must state more."""


class UnreadError(NoProposalError):
    """Error that no table of the files has a meaning: a file is no table, or its columns do not fit."""
