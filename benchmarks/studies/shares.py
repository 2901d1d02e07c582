"""Programs as people write them: how many moves to numbers are known as sent, and after one question.

The programs are templates in `packages/robotprograms/tests/forms`, with numbers from another generator.
"""

from __future__ import annotations

from benchmarks.report import Figure, Section
from packages.robotprograms.tests.program_support.program_forms import LANGUAGES, judge, read_forms

__all__ = ["run"]

LEAST = {"krl": (0.7, 0.9), "rapid": (0.9, 0.95), "urscript": (0.65, 0.8), "fanuc": (0.4, 0.6)}


def run(*, quick: bool) -> list[Section]:
    """Share of the moves to numbers whose target, base and tool are known."""
    rows, figures, wrong = [], list[Figure](), 0
    for language in LANGUAGES:
        forms = list(read_forms(language))[: 3 if quick else None]
        sent, after = ([judge(form, trust_routines=trust) for form in forms] for trust in (False, True))
        count = sum(len(form.truth) for form in forms)
        shares = [sum(len(each.known) for each in judged) / count for judged in (sent, after)]
        wrong += sum(len(each.wrong) for each in (*sent, *after))
        rows.append((language, str(len(forms)), str(count), *(f"{share:.1%}" for share in shares)))
        if not quick:
            figures += [
                Figure(f"{language}, {when}", share, "at least", least)
                for when, share, least in zip(
                    ("as sent", "after the question"), shares, LEAST[language], strict=True
                )
            ]
    return [
        Section(
            title="Moves to numbers with target, base and tool known",
            columns=("language", "programs", "moves", "as sent", "after the question"),
            rows=tuple(rows),
            figures=(*figures, Figure("moves known wrongly", wrong, "at most", 0)),
        )
    ]
