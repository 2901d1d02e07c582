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
    # places of new fields whose values follow from their definition → value
    defined: tuple[tuple[str, float], ...] = ()


def _move(document: Document, path: str, names: dict[str, str]) -> None:
    """Move fields of the object at a path into the object around it; an emptied object is removed.

    Args:
        document: document.
        path: place of objects; places that have no object are left as they are.
        names: name of a field in the object → its name outside.
    """
    for parent, name in list(find_parents(document, path)):
        inner = parent[name]
        if not isinstance(inner, dict):
            continue
        del parent[name]
        for old_name, new_name in names.items():
            if old_name in inner:
                parent[new_name] = inner.pop(old_name)
        if inner:
            parent.setdefault(name, inner)


def _rename(document: Document, path: str, name: str) -> None:
    """Rename the field at a path."""
    for parent, old_name in list(find_parents(document, path)):
        parent.setdefault(name, parent.pop(old_name))


def _remove_null(document: Document, path: str) -> None:
    """Remove the field at a path where it is null."""
    for parent, name in list(find_parents(document, path)):
        if parent[name] is None:
            del parent[name]


def _objects(document: Document, path: str) -> Iterator[Document]:
    """Yield the objects at a path."""
    for value in find_values(document, path):
        if isinstance(value, dict):
            yield value


# Version 9 (layouts 0009 to 0013) to version 14


def _raise_job_9(document: Document) -> None:
    """Put the requester's key into fields of the job."""
    _move(document, "requested_by", {"key_id": "key_id", "key_name": "key_name"})
    _remove_null(document, "requested_by")


def _raise_joints_9(document: Document, path: str) -> None:
    """Keep the one-sided bound of the stiffness of the joints at a path."""
    for joint in _objects(document, path):
        _move(joint, "one_sided", {"stiffness_at_least": "stiffness_at_least"})


def _raise_resampling_9(document: Document, path: str) -> None:
    """Put the statistics of the compensation into fields of the resampling at a path."""
    names = {name: f"compensation_{name}" for name in ("mean", "deviation", "interval")}
    _move(document, f"{path}.compensation", names)


def _raise_run_9(document: Document) -> None:
    """Raise a run."""
    _raise_job_9(document)
    _raise_joints_9(document, "result.joints[]")
    _raise_resampling_9(document, "result.resampling")
    _move(document, "result.goodness.test", {"p_value": "p_value", "verdict": "test"})
    robust = {"threshold": "huber_threshold"} | {name: name for name in ("suspicious", "suspicious_count")}
    _move(document, "result.robust", robust)
    for result in _objects(document, "result"):
        if isinstance(result.get("selection"), dict) and isinstance(result.get("choice"), dict):
            for name in ("models", "losses", "best", "simplest"):
                if name in result["selection"]:
                    result["choice"].setdefault(name, result["selection"].pop(name))
    for model in _objects(document, "result.choice.models[]"):
        model.setdefault("mean_residual", None)
    for base in _objects(document, "result.links.base"):
        base.setdefault("joint", None)


def _raise_comparison_9(document: Document) -> None:
    """Raise a comparison."""
    _raise_job_9(document)
    _rename(document, "first_set_id", "measurement_set_id")
    _raise_joints_9(document, "result.entries[].joints[]")
    _raise_resampling_9(document, "result.entries[].resampling")


def _raise_geometry_9(document: Document) -> None:
    """Raise a geometry."""
    _raise_job_9(document)
    _move(document, "request.base", {"by": "base", "height": "base_height"})
    _move(document, "request.flange", {"by": "flange", "targets": "flange_targets"})
    _move(document, "request.base_targets", {"before": "base_targets_before", "after": "base_targets_after"})
    _remove_null(document, "request.base_targets")
    for axis in _objects(document, "result.axes[]"):
        # The place in R0; the place in the tracker's frame has no place any more.
        _move(axis, "base", {"point": "point", "direction": "direction"})
    for sweep in _objects(document, "result.sweeps[]"):
        _spread_targets_9(sweep)
    goodness = ("sigma", "sigma_source", "degrees_of_freedom", "variance_factor")
    probabilities = ("agreement_probability", "controller_probability")
    _move(document, "result.goodness", {name: name for name in (*goodness, *probabilities)})
    frame = {"transform_tracker_to_base": "transform_tracker_to_base", "covariance": "transform_covariance"}
    _move(document, "result.base_frame", {"by": "base"} | frame)
    for combined in _objects(document, "result.wrist.combined"):
        combined.setdefault("way", "combined")
        combined.setdefault("weight", 1.0)


def _spread_targets_9(sweep: Document) -> None:
    """Put the residuals of the targets of a sweep into one field for each direction."""
    targets = sweep.get("targets")
    if not isinstance(targets, list):
        return
    for quantity in ("radial_rms", "axial_rms"):
        sweep.setdefault(quantity, {target["name"]: target.pop(quantity, None) for target in targets})


def _raise_plan_9(document: Document) -> None:
    """Raise a plan."""
    _raise_job_9(document)
    _rename(document, "result.readings[].validation", "held_out")


def _raise_map_9(document: Document) -> None:
    """Raise a map: percentages become the names of its percentiles."""
    _raise_job_9(document)
    for result in _objects(document, "result"):
        quantiles = result.get("quantiles")
        if isinstance(quantiles, list):
            percentiles = {f"{100.0 * each['share']:g}": each.pop("deflection") for each in quantiles}
            result.setdefault("percentiles", percentiles)


def _raise_program_9(document: Document) -> None:
    """Raise a program."""
    _raise_job_9(document)
    names = {"displacement": "max_displacement", "rotation": "max_rotation", "ramp": "ramp_length"}
    _move(document, "request.limits", names)


def _raise_robot_9(document: Document) -> None:
    """Raise a robot."""
    _move(document, "wrist", {"spherical": "spherical_wrist", "miss_distance": "wrist_miss_distance"})


def _raise_set_9(document: Document) -> None:
    """Raise a measurement set."""
    _move(document, "resolved_frame", {"flange_targets": "geometry_targets"})


def _raise_live_entry_9(document: Document) -> None:
    """Raise an entry of a live campaign."""
    _rename(document, "held_out.share", "ball_ratio")


def _raise_prediction_9(document: Document) -> None:
    """Raise a prediction: intervals are fields of the case, contributions have names."""
    for case in _objects(document, "cases[]"):
        intervals = case.get("readings_only")
        if isinstance(intervals, dict):
            case["readings_only"] = intervals.get("displacement")
            case["rotation_interval"] = intervals.get("rotation")
        else:
            case.setdefault("rotation_interval", None)
    for budget in _objects(document, "cases[].budget"):
        components = budget.get("components")
        if isinstance(components, list):
            included = [each["source"] for each in components if each["included"]]
            contributions = {each["source"]: each.pop("contribution") for each in components}
            budget |= {"contributions": contributions, "included": included}


_JOINTS_9: Final = ("one_sided", "budget")
_OLD_JOINTS: Final = tuple(f"result.joints[].{name}" for name in _JOINTS_9)
_OLD_ENTRIES: Final = tuple(f"result.entries[].joints[].{name}" for name in _JOINTS_9)
_OLD_RUN: Final = (
    *_OLD_JOINTS,
    "result.selection",
    "result.choice.plain",
    "result.links.model",
    "result.links.model_source",
    "result.links.loss",
    "result.goodness.test.p_value",
    "result.robust",
    "result.resampling.compensation",
)
_OLD_GEOMETRY: Final = (
    "result.axes[].tracker",
    "result.axes[].base",
    "result.sweeps[].targets",
    "result.dh[].parallel",
    "result.goodness",
    "result.base_frame",
)
_OLD_OPEN_SET: Final = tuple(
    f"open.{name}"
    for name in ("accept_verdict", "readings", "criterion", "causes", "leave_out", "validation", "prior")
)

_FROM_9: Final = (
    Step(9, 14, ("run",), _raise_run_9, _OLD_RUN),
    Step(9, 14, ("comparison",), _raise_comparison_9, (*_OLD_ENTRIES,)),
    Step(
        9,
        14,
        ("geometry",),
        _raise_geometry_9,
        _OLD_GEOMETRY,
        defined=(("result.wrist.combined.weight", 1.0),),
    ),
    Step(9, 14, ("plan",), _raise_plan_9),
    Step(9, 14, ("map",), _raise_map_9, ("result.quantiles",)),
    Step(9, 14, ("program",), _raise_program_9, ("request.limits",)),
    Step(9, 14, ("robot",), _raise_robot_9, ("archived", "alarms")),
    Step(9, 14, ("measurement_set",), _raise_set_9, ("archived",)),
    Step(9, 14, ("open_set",), dropped=_OLD_OPEN_SET),
    Step(9, 14, ("prediction",), _raise_prediction_9, ("postures_needed", "cases[].budget.components")),
    Step(9, 14, ("live_entry",), _raise_live_entry_9, ("innovation.label", "held_out.inside")),
)


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


_LEAST_MISTAKES: Final = tuple(
    f"result.causes[].{field}" for field in ("least_found", "unit", "joint", "moves")
)
"""Places of the least mistake that the test of a cause finds."""

STEPS: Final[tuple[Step, ...]] = (
    *_FROM_9,
    Step(14, 17, KINDS),
    Step(17, 18, KINDS),
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
)
"""All steps; those from one version come after those to that version."""

OLDEST: Final = STEPS[0].before
"""Version of documents without a version."""
NEWEST: Final = STEPS[-1].after
"""Version of new documents."""
