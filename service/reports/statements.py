"""Statements that every report of a run makes, and where it answers ISO/IEC 17025."""

from __future__ import annotations

from typing import Final

NOT_ISO_9283: Final = (
    "The results are derived from the identified stiffness of the joints. They are not a test of static "
    "compliance after ISO 9283:1998, clause 10, and do not replace one."
)
STATEMENTS: Final = (
    "The results relate only to the item that is identified here, in the state and under the conditions of "
    "the measurement.",
    NOT_ISO_9283,
    "This report may be reproduced only in full, except with the laboratory's approval.",
    "No statement of conformity with a specification is made. The verdicts are opinions by the rules of the "
    "software, which are published with it; they say whether a number may be used, not whether the item is "
    "good.",
    "Sampling: none. All observations of the measurement set were used, except those named under deviations.",
    "Results from external providers: none, except the readings if the laboratory did not take them; the "
    "operator is named above.",
)

IDENTIFICATION: Final = "Identification"
REQUESTED: Final = "What was asked for"
RESULTS: Final = "Results"
UNCERTAINTY: Final = "Uncertainty budget"
METHOD: Final = "Method and deviations from it"
ADJUSTMENT: Final = "Before and after adjustment"
TRACEABILITY: Final = "Conditions and traceability"
ASSESSMENT: Final = "Assessment and warnings"
STATED: Final = "Statements"
ORIGIN: Final = "Origin of the numbers"
ITEMS_HEADING: Final = "Items of ISO/IEC 17025:2017 and their places in this report"

ITEMS: Final = (
    ("7.8.2.1 a", "title", "above"),
    ("7.8.2.1 b", "name and address of the laboratory", "letterhead"),
    ("7.8.2.1 c", "location of the activities", IDENTIFICATION),
    ("7.8.2.1 d", "unique identification on each page, end mark", "head and foot of each page, end"),
    ("7.8.2.1 e", "customer", IDENTIFICATION),
    ("7.8.2.1 f", "method", METHOD),
    ("7.8.2.1 g", "item: description, identification, condition", IDENTIFICATION),
    ("7.8.2.1 h", "date of receipt", IDENTIFICATION),
    ("7.8.2.1 i", "dates of the activities", IDENTIFICATION),
    ("7.8.2.1 j", "date of issue", IDENTIFICATION),
    ("7.8.2.1 k", "sampling", STATED),
    ("7.8.2.1 l", "results relate only to the item", STATED),
    ("7.8.2.1 m", "results with units", RESULTS),
    ("7.8.2.1 n", "additions to, deviations and exclusions from the method", METHOD),
    ("7.8.2.1 o", "who authorised the report", IDENTIFICATION),
    ("7.8.2.1 p", "results from external providers", STATED),
    ("7.8.4.1 a", "measurement uncertainty", f"{RESULTS}, {UNCERTAINTY}"),
    ("7.8.4.1 b", "conditions that influence the results", TRACEABILITY),
    ("7.8.4.1 c", "metrological traceability", TRACEABILITY),
    ("7.8.4.1 d", "results before and after adjustment or repair", ADJUSTMENT),
    ("7.8.4.1 e", "statement of conformity", f"{STATED}: none"),
    ("7.8.4.1 f", "opinions and interpretations", ASSESSMENT),
)
"""Item, what it asks for, and the section that answers it."""
