"""Records of all files put together by their labels: nothing twice, nothing contradictory, nothing lost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from statistics import median, pstdev
from types import MappingProxyType
from typing import Final, Literal

from jointstiff.schemas.importing import State
from jointstiff.schemas.measurement import MAX_OBSERVATIONS, MAX_TARGETS
from jointstiff.service.importing.errors import Faults, ImportFileError, Place, shown
from jointstiff.service.importing.records import Point, Record, Vector
from jointstiff.service.importing.words import Kind

_U95: Final[Mapping[Literal["coordinate", "point"], str]] = MappingProxyType(
    {
        "coordinate": "U(95) X, Y, Z was read as the expanded uncertainty of each coordinate: σ = U/1.96",
        "point": "U(95) was read as the expanded uncertainty of each point, the root of the squares of its "
        "coordinates' uncertainties: σ = U/(1.96 √3), for both states the root of the mean square",
    }
)
_FAR: Final = 100.0
"""Distance of a value from its column's median, in spreads, beyond which it is asked about."""
_LEAST: Final = 5
"""Values of a column that has a spread."""
_LISTED: Final = 3
"""Labels named in a message."""
_HALVES: Final[tuple[set[State], ...]] = ({"unloaded"}, {"loaded"})


@dataclass(slots=True)
class Gathered:
    """Values collected for one observation."""

    label: str  # its label
    place: Place  # where it is first spoken of
    # joint angles, force, moment, load point, and where they stand
    values: dict[Kind, tuple[Vector, Place]] = field(default_factory=dict)
    points: dict[str, dict[State, Point]] = field(default_factory=dict)  # points by target, then state
    held_out: bool = False  # whether it is held out from the fit


@dataclass(frozen=True, slots=True)
class Assembly:
    """All observations, in order of appearance, checked against each other."""

    # with complete readings only, unless a state is absent from all of them
    observations: tuple[Gathered, ...]
    targets: tuple[str, ...]  # names, in order of appearance
    states: tuple[State, ...]  # states that were read at all
    assumptions: tuple[str, ...]  # what was left out, in words
    # what every reading states its own uncertainty by; None if the files have none
    uncertainty: Literal["coordinate", "point"] | None = None
    unusual: tuple[str, ...] = ()  # values far from all others of their column, in words

    @property
    def held_out(self) -> list[str]:
        """Return the labels of the observations that are held out from the fit."""
        return [one.label for one in self.observations if one.held_out]

    @property
    def places(self) -> dict[str, str]:
        """Return the name of its place in the flange by each target that was read as a deflection."""
        read = [point for point in _points(self.observations) if point.state == "deflection"]
        return {point.target: point.along[0] if point.along else point.target for point in read}

    @property
    def one_state(self) -> bool:
        """Return whether positions were read in one state only, so that there is no deflection."""
        return set(self.states) in _HALVES


def assemble(records: Iterable[Record], faults: Faults, *, allow_missing: bool) -> Assembly | None:
    """Put records together.

    Args:
        records: of all files.
        faults: where to tell what is there twice, contradicts, or is missing.
        allow_missing: leave out readings that are not complete instead of refusing them.

    Returns:
        The observations; None if there are faults, also of the files.

    Raises:
        ImportFileError: there are too many observations or targets.
    """
    gathered: dict[str, Gathered] = {}
    whole: dict[tuple[str | None, str], Place] = {}
    for record in records:
        with faults.collected():
            before = whole.setdefault((record.place.file, record.label), record.place)
            if record.whole and before is not record.place:
                raise _twice(f"the label {shown(record.label)}", record.place, before)
            _add(gathered.setdefault(record.label, Gathered(record.label, record.place)), record, faults)
        if len(gathered) > MAX_OBSERVATIONS:
            raise ImportFileError(
                record.place,
                f"there are more than {MAX_OBSERVATIONS} observations",
                "split the campaign into several sets",
            )
    if faults.found:
        return None
    observations = list(gathered.values())
    targets = _targets(observations)
    _check_values(observations, faults)
    order: tuple[State, ...] = ("unloaded", "loaded", "deflection")
    present = {state for one in observations for states in one.points.values() for state in states}
    states = tuple(state for state in order if state in present)
    notes: list[str] = []
    if targets and present not in _HALVES:
        observations, notes = _complete(observations, targets, faults, allow_missing=allow_missing)
    sigmas = _check_sigmas(observations, faults)
    for kind, count in sigmas.items():
        notes.append(f"{_U95[kind]}{f' ({count} points)' if len(sigmas) > 1 else ''}")
    if faults.found:
        return None
    unusual = tuple(_unusual(observations))
    return Assembly(tuple(observations), targets, states, tuple(notes), next(iter(sigmas), None), unusual)


def _twice(what: str, place: Place, before: Place) -> ImportFileError:
    return ImportFileError(place, f"{what} occurs twice, first at {before}", "rename or remove one of them")


def _add(gathered: Gathered, record: Record, faults: Faults) -> None:
    gathered.held_out |= record.held_out
    for kind, vector in record.values.items():
        before, place = gathered.values.setdefault(kind, (vector, record.place))
        if before != vector:
            faults.report(
                record.place,
                f"the {kind} of {shown(record.label)} differs from that at {place}",
                "give each observation a unique label, or correct one of them",
            )
    for point in record.points:
        states = gathered.points.setdefault(point.target, {})
        if point.state in states:
            what = f"{point.target} {point.state} of {shown(record.label)}"
            faults.add(_twice(what, point.place, states[point.state].place))
        states[point.state] = point


def _targets(observations: Iterable[Gathered]) -> tuple[str, ...]:
    targets: dict[str, None] = {}
    for one in observations:
        for target, states in one.points.items():
            targets.setdefault(target)
            if len(targets) > MAX_TARGETS:
                raise ImportFileError(
                    next(iter(states.values())).place,
                    f"there are more than {MAX_TARGETS} targets: {shown(', '.join(targets))}",
                    "check which part of a name is the target; use `point_name` or `file_name`",
                )
    return tuple(targets)


def _check_values(observations: list[Gathered], faults: Faults) -> None:
    """Check that what one observation has, all have."""
    kinds = dict.fromkeys(kind for one in observations for kind in one.values)
    for kind in kinds:
        having = [one for one in observations if kind in one.values]
        lacking = [one for one in observations if kind not in one.values]
        if lacking:
            others = f" and {len(lacking) - 1} others have" if len(lacking) > 1 else " has"
            faults.report(
                lacking[0].place,
                f"{shown(lacking[0].label)}{others} no {kind}, but other labels have: {_listed(having)}",
                f"spell labels alike in all files; without {kind}: {_listed(lacking)}",
            )
        count = len(having[0].values[kind][0])
        for one in having:
            vector, place = one.values[kind]
            if len(vector) != count:
                faults.report(
                    place,
                    f"there are {len(vector)} joint angles here, but {count} in other observations",
                    "check the columns of joints",
                )


def _listed(observations: list[Gathered]) -> str:
    """Return the first labels, in words."""
    names = ", ".join(shown(one.label) for one in observations[:_LISTED])
    return names + ", …" * (len(observations) > _LISTED)


def _check_sigmas(observations: list[Gathered], faults: Faults) -> dict[Literal["coordinate", "point"], int]:
    """Return how many points have an uncertainty by their coordinates, and by themselves.

    That only some points have one is a fault; those without a position need none.
    """
    counts: dict[Literal["coordinate", "point"], int] = {}
    without: Place | None = None
    for point in _points(observations):
        if point.sigma is not None:
            kind: Literal["coordinate", "point"] = "point" if point.by_point else "coordinate"
            counts[kind] = counts.get(kind, 0) + 1
        elif point.vector is not None and point.along is None:
            without = without or point.place
    if counts and without is not None:
        reason = "the point has no uncertainty, but others have"
        faults.report(without, reason, "add it, or skip the columns of U(95) with `ignore`")
    return dict(sorted(counts.items()))


def _points(observations: Iterable[Gathered]) -> Iterator[Point]:
    return (point for one in observations for states in one.points.values() for point in states.values())


def _unusual(observations: list[Gathered]) -> Iterator[str]:
    """Yield the values that are 100 times their column's spread from its median.

    The spread is the standard deviation of the nine tenths that are nearest to the median; where these are
    all alike, their size stands for it.
    """
    columns: dict[str, list[tuple[float, Place]]] = {}
    for one in observations:
        vectors = [(str(kind), *value) for kind, value in one.values.items()]
        points = [point for states in one.points.values() for point in states.values()]
        vectors += [(f"{point.target} {point.state}", point.vector or (), point.place) for point in points]
        for name, vector, place in vectors:
            for axis, value in enumerate(vector):
                part = str(axis + 1) if name == "joint" else "xyz"[axis]
                columns.setdefault(f"{name} {part}", []).append((value, place))
    for name, values in columns.items():
        if len(values) >= _LEAST:
            yield from _far_from_others(name, values)


def _far_from_others(name: str, values: list[tuple[float, Place]]) -> Iterator[str]:
    middle = median(value for value, _ in values)
    ordered = sorted(values, key=lambda entry: abs(entry[0] - middle))
    near = ordered[: -max(1, len(ordered) // 10)]
    spread = pstdev(value for value, _ in near) or abs(middle)
    for value, place in ordered[len(near) :]:
        times = abs(value - middle) / spread if spread else 0.0
        if times > 0.99 * _FAR:
            yield f"{name} {value:g} ({place}) is {times:.0f} times the spread of the others away"


def _complete(
    observations: list[Gathered], targets: tuple[str, ...], faults: Faults, *, allow_missing: bool
) -> tuple[list[Gathered], list[str]]:
    """Observations with complete readings; the rest is refused, or left out and said."""
    kept, notes = [], []
    gauges = {point.target for point in _points(observations) if point.along is not None}
    lacks: list[tuple[bool, Place, str]] = []
    for one in observations:
        points = {}
        for target in [t for t in targets if t in one.points or t not in gauges]:
            states = one.points.get(target, {})
            with faults.collected():
                lack = _lack(one, target, states)
                if lack is None:
                    points[target] = states
                else:
                    place = next((point.place for point in states.values()), one.place)
                    lacks.append((not states, place, f"{one.label}: {lack}"))
        if points:
            kept.append(replace(one, points=points))
        else:
            notes.append(f"{one.label}: no reading is complete; the observation was skipped")
    if lacks and not allow_missing:
        remedy = "add the reading, check the spelling of names, or use `allow_missing`"
        for _, place, reason in sorted(lacks, key=lambda entry: entry[0]):  # half a reading tells more
            faults.report(place, reason, remedy, "allow_missing")
    notes = [*(f"{reason}; skipped" for _, _, reason in lacks), *notes]
    if not kept:
        faults.report(observations[0].place, "no observation has a reading", "check the names")
    return kept, notes


def _lack(one: Gathered, target: str, states: dict[State, Point]) -> str | None:
    """Return what a reading lacks to be complete, or None."""
    if not states:
        return f"target {target} has no reading"
    present = {state for state, point in states.items() if point.vector is not None}
    if "deflection" in states and len(states) > 1:
        if len(present) > 1 and "deflection" in present:
            raise ImportFileError(
                states["deflection"].place,
                f"{shown(one.label)}: target {target} has both positions and a deflection",
                "omit one of them, for instance with `ignore`",
            )
        states = {state: point for state, point in states.items() if state in present}
    if present in ({"deflection"}, {"unloaded", "loaded"}):
        return None
    if not present:
        return f"the cells of target {target} are empty"
    return f"target {target} was read only {' and '.join(sorted(present))}"
