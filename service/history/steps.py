"""The steps from version to version, in order. A step never changes after its release.

To change the shape of a document: raise `NEWEST`, add a step whose `change` moves what has moved and whose
`dropped` names what has no place any more, and keep an example (CONTRIBUTING, *Change what is stored*).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from jointstiff.service.history.paths import find_parents, find_values

Document = dict[str, Any]

JOBS: Final = ("run", "comparison", "geometry", "plan", "map", "fleet", "program", "process")
"""Kinds of documents that are jobs."""
KINDS: Final = (
    *JOBS,
    *("robot", "measurement_set", "campaign", "open_set", "live_entry", "findings", "prediction"),
)
"""Kinds of documents. `findings` are the warnings of an open set, `prediction` is a saved prediction."""


def leave_unchanged(_document: Document) -> None:
    """Change nothing: later versions of the documents only have more fields, which may be absent."""


@dataclass(frozen=True)
class Step:
    """A step from a version to the next."""

    before: int
    after: int
    kinds: tuple[str, ...]  # kinds of documents that the step changes
    change: Callable[[Document], None] = leave_unchanged  # moves and renames fields, in place
    dropped: tuple[
        str, ...
    ] = ()  # places of fields that have no place after the step; removed after `change`


def _rename(document: Document, path: str, name: str) -> None:
    """Rename the field at a path."""
    for parent, old_name in list(find_parents(document, path)):
        parent.setdefault(name, parent.pop(old_name))


def _objects(document: Document, path: str) -> Iterator[Document]:
    """Yield the objects at a path."""
    for value in find_values(document, path):
        if isinstance(value, dict):
            yield value


def _state_verdicts_of_campaigns(trend: Document) -> None:
    """State the verdict of each campaign also outside the assessment, which a long trend leaves out."""
    trend.setdefault("campaign_count", len(trend["campaigns"]))
    for campaign in trend["campaigns"]:
        if campaign["assessment"] is not None:
            campaign.setdefault("verdict", campaign["assessment"]["verdict"])


def _set_absolute_loss_aside(run: Document) -> None:
    """Move the request of the loss `absolute`, which newer versions do not compute, out of the options."""
    for options in _objects(run, "request"):
        if options.get("loss") == "absolute":
            options["absolute_loss"] = options.pop("loss")


def _name_the_same_load(comparison: Document) -> None:
    """Rename the option that the load of both sets acted at the same point."""
    _rename(comparison, "request.same_load_point", "same_load")


def _state_one_solution(run: Document) -> None:
    """Move the compliances that predict to their joints, or to the own weight if they are of the sag.

    Runs in which only joints bend state these compliances once more, without the joints that are not known.
    """
    for result in _objects(run, "result"):
        model = result.get("model")
        if not isinstance(model, dict) or "compliance" not in model:
            continue
        if model.get("elastic"):
            for joint, compliance in zip(result["joints"], model.pop("compliance"), strict=True):
                joint.setdefault("own_compliance", compliance)
        elif model.get("weight"):
            model["weight"].setdefault("compliance", model.pop("compliance"))


_LEAST_MISTAKES: Final = tuple(
    f"result.causes[].{field}" for field in ("least_found", "unit", "joint", "moves")
)
"""Places of the least mistake that the test of a cause finds."""

STEPS: Final[tuple[Step, ...]] = (
    Step(18, 19, tuple(kind for kind in KINDS if kind not in {"run", "process"})),
    Step(18, 19, ("process",), dropped=("request.step", "request.smoothness")),
    Step(18, 19, ("run",), _set_absolute_loss_aside, ("request.absolute_loss",)),
    Step(18, 19, ("trend",), _state_verdicts_of_campaigns),
    Step(19, 21, tuple(kind for kind in KINDS if kind not in {"run", "comparison", "process"})),
    # Documents of version 19 were stored before the fields above left, too.
    Step(19, 21, ("process",), dropped=("request.step", "request.smoothness")),
    Step(19, 21, ("comparison",), _name_the_same_load),
    Step(19, 21, ("run",), _set_absolute_loss_aside, ("request.absolute_loss", *_LEAST_MISTAKES)),
    Step(21, 22, KINDS),
    Step(22, 23, tuple(kind for kind in KINDS if kind != "run")),
    # A run of version 19 may have been rewritten to version 21 or 22 with this loss.
    Step(22, 23, ("run",), _set_absolute_loss_aside, ("request.absolute_loss",)),
    Step(23, 24, (*(kind for kind in KINDS if kind != "run"), "correction")),
    Step(23, 24, ("run",), _state_one_solution, ("result.model.compliance",)),
)
"""All steps; those from one version come after those to that version."""

OLDEST: Final = STEPS[0].before
"""Version of documents without a version."""
NEWEST: Final = STEPS[-1].after
"""Version of new documents."""
