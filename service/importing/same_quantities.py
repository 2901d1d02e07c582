"""Quantities, such as joints or the force, that all observations of a set must have."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final

from jointstiff.service.importing.errors import Faults, quote
from jointstiff.service.importing.grammar import Kind, Quantity
from jointstiff.service.importing.rows import ObservationRecord

_MAX_LISTED_LABELS: Final = 3
"""Labels named in a message."""
_MONTH: Final = (
    "(?:jan|ene|gen|feb|fév|fev|mar|mär|mrz|apr|avr|abr|may|mai|mag|jun|juin|giu|jul|juil|lug|aug|aoû|ago|sep|set|"
    "oct|okt|ott|out|nov|dec|dez|déc|dic)[^\\W\\d]{0,7}[.]?"
)
_DATE: Final = re.compile(
    rf"\d{{1,2}}[-. /]{{1,2}}{_MONTH}(?:[-. /]\d{{2,4}})?|{_MONTH}[-. /]\d{{1,4}}"
    r"|\d{4}-\d\d-\d\d(?:[ T]00:00:00)?|\d{1,2}[./]\d{1,2}[./]\d{4}",
    re.IGNORECASE,
)
"""A date, as spreadsheets show the date that they made of a label."""
_PARTS_OF_DATE: Final = re.compile(r"\d{1,2}[-./]\d{1,2}")
"""A label that spreadsheets take as a day and a month."""


def check_same_quantities(observations: list[ObservationRecord], faults: Faults) -> None:
    """Report observations that lack joint angles, a force or a quantity that others have."""
    for kind in _list_kinds_of_quantities(observations):
        with_kind = [observation for observation in observations if observation.vector(kind) is not None]
        without_kind = [observation for observation in observations if observation.vector(kind) is None]
        if without_kind:
            _report_lacking_quantity(kind, without_kind, with_kind, faults)
        _report_other_counts(kind, with_kind, faults)


def skip_incomplete_observations(
    observations: Sequence[ObservationRecord],
) -> tuple[list[ObservationRecord], list[str]]:
    """Return the observations with all quantities, such as joint angles, that others have; and notes."""
    kinds = _list_kinds_of_quantities(observations)
    complete, notes = list[ObservationRecord](), list[str]()
    for observation in observations:
        lacking = [kind for kind in kinds if observation.vector(kind) is None]
        if lacking:
            notes.append(f"{observation.label}: no {' and no '.join(lacking)}; the observation was skipped")
        else:
            complete.append(observation)
    return (complete, notes) if complete else (list(observations), [])


def _list_kinds_of_quantities(observations: Iterable[ObservationRecord]) -> list[Kind]:
    """Return the kinds of quantities of whole observations, not of targets, that occur."""
    quantities = (quantity for observation in observations for quantity in observation.values)
    return list(dict.fromkeys(quantity.kind for quantity in quantities if quantity.target is None))


def _report_lacking_quantity(
    kind: Kind, without: list[ObservationRecord], others: list[ObservationRecord], faults: Faults
) -> None:
    """Report that the observations `without` lack a quantity, such as the force, that `others` have."""
    first = quote(without[0].label)
    lack = f"{first} and {len(without) - 1} others have" if len(without) > 1 else f"{first} has"
    reason = f"{lack} no {kind}, but other labels have: {_list_labels(others)}"
    remedy = (
        f"add the {kind} of these labels, spell labels alike in all files, or use `allow_missing` to skip "
        f"them; these labels have no {kind}: {_list_labels(without)}"
    )
    for dates, numbers in ((without, others), (others, without)):
        if all(_DATE.fullmatch(each.label) for each in dates) and all(
            _PARTS_OF_DATE.fullmatch(each.label) for each in numbers
        ):
            reason += (
                f"; a spreadsheet seems to have turned labels such as {quote(numbers[0].label)} into dates "
                f"such as {quote(dates[0].label)}"
            )
            remedy = (
                "give the column of labels the format of texts in the spreadsheet, and write the labels "
                f"again: {_list_labels(numbers)}"
            )
    faults.report(without[0].place, reason, remedy, "allow_missing")


def _report_other_counts(kind: Kind, observations: list[ObservationRecord], faults: Faults) -> None:
    """Report observations that have another number of joint angles than the first of them.

    Other quantities than joint angles always have three numbers, or one.
    """
    count = len(observations[0].vector(kind) or ())
    for observation in observations:
        value = observation.values[Quantity(kind)]
        own_count = len(value.vector or ())
        if own_count != count:
            reason = f"this observation has {own_count} joint angles, but other observations have {count}"
            faults.report(value.place, reason, "check the columns of joints")


def _list_labels(observations: list[ObservationRecord]) -> str:
    """Return the first three labels of some observations in one text."""
    names = ", ".join(quote(observation.label) for observation in observations[:_MAX_LISTED_LABELS])
    return names + ", …" * (len(observations) > _MAX_LISTED_LABELS)
