"""Turned and placed paths by length and feed: limits at every 0.1 mm, what is left of the deflection, time.

Arms are those of five makers in the catalogue, with the speeds of their joints. Their stiffnesses by the
prior of payload and reach are drawn within a factor of two; the choice knows them with errors of 5 %, and is
judged by the true ones. Paths have eight shapes, at random places, with points 1 mm apart; 0.5 and 5 mm in
the table of samplings, and 2,700 points in that of times. Without `--all` some of the feeds, samplings and
places are left out, so that the study ends within 10 minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import median
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.report import Figure, Section
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.constraints import Bounds, Constraints
from jointstiff.solver.fit.stages import Likelihood
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.predict.models import JointModel
from jointstiff.solver.process.blend import blend_loads
from jointstiff.solver.process.deflection import PathDeflection
from jointstiff.solver.process.knots import find_knots, find_spacing
from jointstiff.solver.process.pace import Pace
from jointstiff.solver.process.path import ProcessPath
from jointstiff.solver.process.placing import PlaceBox, coarsen, evaluate_places
from jointstiff.solver.process.prior import FACTOR, assume_unseen_joints, build_prior_model
from jointstiff.solver.process.turning import Lattice, TurnChoice, TurnTask, choose_turns
from tests.support.catalogue_arms import build_nominal_robots
from tests.support.process_paths import reach_centre, spindle_at

__all__ = ["run"]

ARMS = (
    "FANUC R-2000iC/210F",
    "KUKA KR 210 R2700 extra",
    "ABB IRB 6640-185/2.8",
    "ABB IRB 6700-200/2.60",
    "Yaskawa GP180",
)
ANGLES = (45, 90)
FEEDS = (20.0, 50.0, 100.0, 200.0)
REQUIRED = {45: (0.82, 0.62), 90: (0.78, 0.50)}
"""Angle between spindle and last axis [°] → required at 50 mm/s: turned, relative to the median fixed
turn, and placed, relative to the path as programmed."""
CLEARANCE = 0.04
FORCE = np.array([-150.0, 350.0, -120.0])
"""Along feed, normal and spindle axis [N]."""
OFFSET = np.array([0.1, 0.0, 0.3])
FINE = 1e-4
"""Distance of the places between points at which limits are checked [m]."""
HALF = np.array([0.25, 0.25, 0.2])
GRID = (3, 3, 2)
PLACE_TURNS = 4
MANY = 2700
"""Points of the paths whose time is measured."""
CORNER = np.cos(np.radians(20.0))
"""Cosine of the change of direction at a corner, where a controller leaves the feed."""
SAMPLINGS = (5e-4, 1e-3, 5e-3)
"""Distances of points [m]."""
UNSEEN = ((0,), (0, 5), (3,))
"""Joints, from 0, that a campaign does not see."""


CORNERS = {
    "zigzag": np.array(
        [(x, 0.012 * r - 0.048) for r in range(9) for x in ((-0.06, 0.06), (0.06, -0.06))[r % 2]]
    ),
    "trim": np.array([(-0.15, 0.0), (0.1, 0.0), (0.1, 0.2)]),
}
"""Corners (c, 2) of paths of lines [m]."""


def _find_fractions(corners: FloatArray) -> FloatArray:
    """Return the fractions (c,) of the length of a line at its corners (c, 2)."""
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    fractions: FloatArray = lengths / lengths[-1]
    return fractions


def _along(corners: FloatArray, u: FloatArray) -> FloatArray:
    """Return places (k, 3) at fractions u of the length of a line of corners (c, 2)."""
    x, y = (np.interp(u, _find_fractions(corners), corners[:, i]) for i in range(2))
    return np.column_stack([x, y, 0.0 * u])


def _zigzag(u: FloatArray) -> FloatArray:
    return _along(CORNERS["zigzag"], u)


def _spiral(u: FloatArray) -> FloatArray:
    t, r = 5.0 * np.pi * u, 0.05 + 0.1 * u
    return np.column_stack([r * np.cos(t), r * np.sin(t), -0.01 * u])


def _cylinder(u: FloatArray) -> FloatArray:
    t = 2.2 * u - 1.1
    return np.column_stack([0.25 * np.sin(t), 0.3 * (u - 0.5), 0.25 * np.cos(t)])


def _edge(u: FloatArray) -> FloatArray:
    return np.column_stack([0.05 * np.sin(6.0 * u), 0.5 * (u - 0.5), 0.1 * np.cos(4.0 * u)])


def _contour(u: FloatArray) -> FloatArray:
    t = 2.0 * np.pi * u
    squared = np.stack([np.cos(t), np.sin(t)], axis=1)
    squared /= (np.abs(squared) ** 4).sum(axis=1, keepdims=True) ** 0.25
    return np.column_stack([0.15 * squared[:, 0], 0.1 * squared[:, 1], 0.0 * u])


def _blade(u: FloatArray) -> FloatArray:
    t = 2.0 * u - 1.0
    return np.column_stack([0.2 * t, 0.02 * np.sin(2.0 * t), 0.03 * np.cos(1.5 * t)])


def _trim(u: FloatArray) -> FloatArray:
    return _along(CORNERS["trim"], u)


def _wave(u: FloatArray) -> FloatArray:
    return np.column_stack([0.4 * (u - 0.5), 0.05 * np.sin(8.0 * u), 0.0 * u])


SHAPES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "zigzag": _zigzag,
    "spiral": _spiral,
    "cylinder": _cylinder,
    "edge": _edge,
    "contour": _contour,
    "blade": _blade,
    "trim": _trim,
    "wave": _wave,
}


def _axes(shape: str, places: FloatArray) -> FloatArray:
    """Return the directions (k, 3) from spindle to tip of a shape."""
    count = len(places)
    if shape == "cylinder":
        t = np.arctan2(places[:, 0], places[:, 2])
        return -np.column_stack([np.sin(t), 0.0 * t, np.cos(t)])
    if shape == "blade":
        t = 0.35 * places[:, 0] / 0.2
        return -np.column_stack([0.0 * t, np.sin(t), np.cos(t)])
    tilted = {"edge": [1.0, 0.0, -0.3], "trim": [0.0, -0.5, -0.866]}
    axis = np.array(tilted.get(shape, [0.0, 0.0, -1.0]))
    return np.tile(axis / np.linalg.norm(axis), (count, 1))


def _make_path(
    shape: str, angle: int, centre: FloatArray, yaw: float, turn: float, spacing: float
) -> ProcessPath:
    """Return the path of a shape at a place, with points `spacing` apart [m]."""
    u = np.linspace(0.0, 1.0, 8001)
    corners = _find_fractions(CORNERS[shape]) if shape in CORNERS else np.zeros(0)
    u = np.union1d(u, corners)
    fine = SHAPES[shape](u)
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1)))
    wanted = np.linspace(0.0, lengths[-1], round(float(lengths[-1]) / spacing) + 1)
    # Corners are points of each sampling, and no point is near them.
    apart = np.abs(wanted[:, None] - corners * lengths[-1]).min(axis=1, initial=np.inf)
    wanted = np.union1d(wanted[apart > 0.3 * spacing], corners * lengths[-1])
    places = np.column_stack([np.interp(wanted, lengths, fine[:, i]) for i in range(3)])
    count = len(places)
    about_z = Rotation.from_euler("z", yaw).as_matrix()
    places, axes = places @ about_z.T + centre, _axes(shape, places) @ about_z.T
    feed = np.gradient(places, axis=0)
    feed -= axes * (feed * axes).sum(axis=1, keepdims=True)
    feed /= np.linalg.norm(feed, axis=1, keepdims=True)
    spindle = spindle_at(np.radians(angle))
    first = Rotation.align_vectors([axes[0]], [spindle])[0]
    poses = np.tile(np.eye(4), (count, 1, 1))
    rotation = Rotation.from_rotvec(turn * axes[0]) * first
    for i in range(count):  # the tool is carried along without a turn about its axis
        if i:
            carried = np.cross(axes[i - 1], axes[i])
            rotation = Rotation.from_rotvec(carried) * rotation
            rotation = Rotation.align_vectors([axes[i]], [rotation.apply(spindle)])[0] * rotation
        poses[i, :3, :3] = rotation.as_matrix()
    poses[:, :3, 3] = places - poses[:, :3, :3] @ OFFSET
    force = FORCE[0] * feed + FORCE[1] * np.cross(axes, feed) + FORCE[2] * axes
    return ProcessPath(
        poses=poses,
        spindle=np.tile(spindle, (count, 1)),
        place=np.tile(OFFSET, (count, 1)),
        load_point=np.tile(OFFSET, (count, 1)),
        force=force,
        moment=np.zeros((count, 3)),
        continuous=np.arange(count) > 0,
        given=np.full((count, 6), np.nan),
    )


@dataclass(frozen=True)
class Case:
    """An arm, its stiffnesses, and a path that it follows as programmed."""

    arm: str
    robot: Robot
    truth: JointModel
    known: JointModel
    inverse: InverseKinematics
    shape: str
    angle: int
    centre: FloatArray
    yaw: float
    turn: float

    def path(self, spacing: float = 1e-3) -> ProcessPath:
        """Return the path with points `spacing` apart [m]."""
        return _make_path(self.shape, self.angle, self.centre, self.yaw, self.turn, spacing)

    def task(self, count: int, feed: float) -> TurnTask:
        """Return the task of a free turn at a feed [mm/s]."""
        return TurnTask.free(72, CLEARANCE, Pace(np.full(count, 1e-3 * feed), self.robot.speeds))


def _draw_case(arm: int, shape: str, angle: int) -> Case:
    """Draw the place of a path that the arm follows at 50 mm/s without a turn."""
    draw = np.random.default_rng([arm, list(SHAPES).index(shape), angle])
    robots = {each.name: each.robot for each in build_nominal_robots()}
    robot = robots[ARMS[arm]]
    compliance = build_prior_model(robot).compliance * 2.0 ** draw.uniform(-1.0, 1.0, robot.n)
    constraints = Constraints(Bounds.positive(robot.n))
    truth = JointModel(robot, compliance, None, constraints)
    known = JointModel(robot, compliance * np.exp(0.05 * draw.standard_normal(6)), None, constraints)
    inverse = InverseKinematics(robot)
    for _ in range(200):
        centre = reach_centre(robot, draw.uniform(0.5, 0.75), draw.uniform(0.1, 0.4), draw.uniform(-0.3, 0.3))
        case = Case(
            ARMS[arm], robot, truth, known, inverse, shape, angle, centre,
            draw.uniform(0.0, 2.0 * np.pi), draw.uniform(0.0, 2.0 * np.pi),
        )  # fmt: skip
        path = case.path(5e-3)
        task = replace(case.task(len(path), 50.0), angles=np.zeros(1))
        try:
            choose_turns(known, inverse, path, task)
        except RequestError:
            continue
        return case
    raise ValueError(f"{ARMS[arm]} follows the path {shape} nowhere")


@dataclass(frozen=True)
class Trace:
    """Needs of a motion at every 0.1 mm, for the controller's joints."""

    share: float  # greatest part of a joint's speed, apart from the lines at corners
    corner: float  # the same on the lines at corners
    outside: int  # places beyond a limit of a joint
    singular: float  # least singular value
    left: int  # places where the controller's line is not followed


def _trace(case: Case, path: ProcessPath, q: FloatArray, feed: float) -> Trace:
    """Follow a motion (m, 6) of the model's joints along a path as the controller does, by code of its own.

    The controller leads the tool's centre along each line at the feed [mm/s], and turns the tool evenly.
    """
    at = Postures(case.robot, q)
    tip = at.to_base(path.place[:, None])[:, 0]
    steps = np.linalg.norm(np.diff(tip, axis=0), axis=1)
    parts = np.maximum(np.round(steps / FINE).astype(int), 1)
    owner = np.repeat(np.arange(len(steps)), parts)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(parts) - parts, parts)
    t = (number / parts[owner])[:, None]
    rotation = at.flange_rotation
    vectors = Rotation.from_matrix(rotation[1:] @ rotation[:-1].transpose(0, 2, 1)).as_rotvec()
    turned = Rotation.from_rotvec(t * vectors[owner]).as_matrix() @ rotation[:-1][owner]
    poses = np.tile(np.eye(4), (len(owner), 1, 1))
    poses[:, :3, :3] = turned
    poses[:, :3, 3] = (1.0 - t) * tip[:-1][owner] + t * tip[1:][owner] - turned @ OFFSET
    guess = q[:-1][owner] + t * np.diff(q, axis=0)[owner]
    fine, reached = case.inverse.refine(poses, guess)
    left = int((~reached).sum() + (np.abs(fine - guess).max(axis=1) > 0.3).sum())
    along = np.vstack([fine, q[-1:]])
    length = (steps / parts)[owner]
    speed = np.abs(np.diff(along, axis=0)) / length[:, None] * 1e-3 * feed
    low, high = case.robot.limits.T
    shares = (speed / case.robot.speeds).max(axis=1)
    at_corner = _find_corner_lines(path.centres)[owner]
    return Trace(
        float(shares[~at_corner].max()),
        float(shares[at_corner].max(initial=0.0)),
        int(((along < low) | (along > high)).any(axis=1).sum()),
        float(case.inverse.least_singular_value(along).min()),
        left,
    )


def _find_corner_lines(centres: FloatArray) -> BoolArray:
    """Return a mask (m - 1,) of the lines that lead to a corner, or from one."""
    steps = np.diff(centres, axis=0)
    unit = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    bends = (unit[1:] * unit[:-1]).sum(axis=1) < CORNER
    lines: BoolArray = np.append(False, bends) | np.append(bends, False)
    return lines


@dataclass(frozen=True)
class Judged:
    """A motion, judged at every 0.1 mm and by the true stiffnesses."""

    size: float  # root mean square of the deflection by the true stiffnesses [m]
    rate: float  # greatest turn for a length [°/mm]
    chosen: Trace
    corrected: Trace


def _judge(case: Case, path: ProcessPath, joints: FloatArray, feed: float) -> Judged:
    """Judge a motion (m, 6) of the controller's joints along a path, by code of its own."""
    q = case.robot.joint_map.model_angles(joints)
    at, cases = Postures(case.robot, q), path.cases(np.arange(len(path)), joints)
    limits = case.task(len(path), feed).pace.limits()
    blend = blend_loads(case.known, cases, path.continuous, limits)
    loads = cases if blend is None else blend.cases
    commanded = case.known.compute_commands(loads, at, np.ones(len(path)))
    steps = np.linalg.norm(np.diff(path.centres, axis=0), axis=1)
    # Turn about the spindle, from the programmed orientation.
    relative = Rotation.from_matrix(at.flange_rotation @ path.poses[:, :3, :3].transpose(0, 2, 1))
    turn = np.unwrap((relative.as_rotvec() * path.axes).sum(axis=1))
    bent = case.truth.deflect(cases).displacement
    weights = np.append(steps, 0.0) + np.append(0.0, steps)
    return Judged(
        float(np.sqrt(np.average(np.square(bent).sum(axis=1), weights=weights))),
        float(np.degrees(np.abs(np.diff(turn) / steps).max()) * 1e-3),
        _trace(case, path, q, feed),
        _trace(case, path, commanded, feed),
    )


def _measure(case: Case, path: ProcessPath, joints: FloatArray) -> float:
    """Return the root mean square of the deflection of a motion by the true stiffnesses [m]."""
    steps = np.linalg.norm(np.diff(path.centres, axis=0), axis=1)
    bent = case.truth.deflect(path.cases(np.arange(len(path)), joints)).displacement
    weights = np.append(steps, 0.0) + np.append(0.0, steps)
    return float(np.sqrt(np.average(np.square(bent).sum(axis=1), weights=weights)))


@dataclass(frozen=True)
class Fixed:
    """Deflections of turns that are the same along the whole path, by the true stiffnesses [m]."""

    median: float
    best: float
    programmed: float  # at turn zero; NaN if it keeps no limits


def _measure_fixed(case: Case, path: ProcessPath, task: TurnTask) -> Fixed:
    """Measure the fixed turns of a path, at its knots."""
    first = np.arange(len(path))
    knots = find_knots(path, find_spacing(path, task.pace, task.step), first)
    lattice = Lattice.build(case.truth, case.inverse, path, task, first, knots)
    sizes = {k: lattice.measure(each) for k, each in lattice.find_fixed().items()}
    return Fixed(median(sizes.values()), min(sizes.values()), sizes.get(0, np.nan))


@dataclass(frozen=True)
class Outcome:
    """A turned path."""

    case: Case
    feed: float
    judged: Judged
    fixed: Fixed
    is_worse: bool  # than the best fixed turn, by the stiffnesses that the choice knows
    is_turned: bool
    seconds: float

    @property
    def ratio(self) -> float:
        """Deflection relative to that of the median fixed turn, by the true stiffnesses."""
        return self.judged.size / self.fixed.median


def _turn(case: Case, feed: float, spacing: float = 1e-3) -> Outcome:
    """Turn the tool along a path."""
    path = case.path(spacing)
    task = case.task(len(path), feed)
    begin = process_time()
    choice = choose_turns(case.known, case.inverse, path, task)
    seconds = process_time() - begin
    judged, fixed = _judge(case, path, choice.joints, feed), _measure_fixed(case, path, task)
    is_turned = bool(np.ptp(choice.turn) > 1e-6)
    return Outcome(case, feed, judged, fixed, _is_worse(choice), is_turned, seconds)


def _is_worse(choice: TurnChoice) -> bool:
    """Return whether a fixed turn is better than the choice."""
    return bool(choice.size > choice.fixed.min() * (1.0 + 1e-3))


def _is_illegal(judged: Judged) -> bool:
    """Return whether a motion is beyond half of a joint's speed, the rate, a limit or the clearance.

    At the corners of corrected paths, where the force turns from one point to the next, speeds do not count:
    a figure of their own counts these paths.
    """
    share = max(judged.chosen.share, judged.chosen.corner, judged.corrected.share)
    is_fast = share > 0.5 * (1.0 + 1e-3) or judged.rate > 1.0 + 1e-3
    traces = (judged.chosen, judged.corrected)
    is_outside = any(each.outside or each.left for each in traces)
    return is_fast or is_outside or min(each.singular for each in traces) < CLEARANCE * (1.0 - 1e-3)


def run(*, quick: bool, full: bool = False) -> Iterator[Section]:
    """Turn paths at several feeds and samplings, place them, and guess joints that were not seen."""
    arms = range(1 if quick else len(ARMS))
    shapes = list(SHAPES)[: 2 if quick else None]
    cases = [_draw_case(arm, shape, angle) for angle in ANGLES for arm in arms for shape in shapes]
    other_feeds = [] if quick else [each for each in FEEDS if each != 50.0]
    tasks = [(case, 50.0) for case in cases]
    tasks += [(case, feed) for case in cases[:: 1 if full else 4] for feed in other_feeds]
    sampled, placed, timed = (cases[:1],) * 3
    if not quick:
        sampled = cases[:: 1 if full else 5]
        placed = cases[::2] if full else cases[::7]
        timed = cases[:: 1 if full else 3]
    yield _report_turned(tasks)
    yield _report_samplings(sampled)
    yield _report_placed(placed, judges=not quick)
    yield _report_times(timed, placed[:: 1 if full or quick else 3])
    yield _report_unseen(2 if quick else 40, judges=not quick)


def _report_turned(tasks: Sequence[tuple[Case, float]]) -> Section:
    """Report paths with points 1 mm apart at several feeds [mm/s]."""
    outcomes = [_turn(case, feed) for case, feed in tasks]
    rows = []
    for angle, feed in sorted({(case.angle, feed) for case, feed in tasks}):
        part = [each for each in outcomes if each.case.angle == angle and each.feed == feed]
        rows.append(
            (
                f"{angle}°", f"{feed:.0f}", str(len(part)),
                f"{median(each.ratio for each in part):.3f}",
                f"{median(each.judged.size / each.fixed.best for each in part):.3f}",
                f"{np.nanmedian([each.judged.size / each.fixed.programmed for each in part]):.3f}",
                f"{max(max(each.judged.chosen.share, each.judged.chosen.corner) for each in part):.3f}",
                f"{max(each.judged.corrected.share for each in part):.3f}",
                f"{max(each.judged.corrected.corner for each in part):.2f}",
                f"{max(each.judged.rate for each in part):.3f}",
                str(sum(_is_illegal(each.judged) for each in part)),
                f"{max(each.seconds for each in part):.2f}",
            )
        )  # fmt: skip
    notes = [
        f"{each.case.arm} {each.case.shape} {each.case.angle}° {each.feed:.0f} mm/s: {each.judged}"
        for each in outcomes
        if _is_illegal(each.judged)
    ]
    count = len(outcomes)
    beyond = f"of {count}: beyond a limit of speed, rate, position or singularity"
    figures = [Figure.none(beyond, len(notes))]
    at_corners = sum(each.judged.corrected.corner > 0.5 * (1.0 + 1e-3) for each in outcomes)
    figures.append(
        Figure.none(f"of {count}: corrected lines at corners beyond half of a joint's speed", at_corners)
    )
    figures.append(
        Figure.none(f"of {count}: worse than the best fixed turn", sum(each.is_worse for each in outcomes))
    )
    for angle, (turned, _) in REQUIRED.items():
        ratios = [each.ratio for each in outcomes if each.case.angle == angle and each.feed == 50.0]
        figures.append(
            Figure(f"{angle}°, 50 mm/s: turned / median fixed turn", median(ratios), "at most", turned)
        )
    columns = ("spindle", "mm/s", "paths", "/ median", "/ best", "/ sent", "speed", "corrected", "corner",
               "°/mm", "illegal", "s")  # fmt: skip
    return Section("Turned by length and feed", columns, tuple(rows), tuple(figures), tuple(notes[:40]))


def _report_samplings(cases: Sequence[Case]) -> Section:
    """Report the same paths with points 0.5, 1 and 5 mm apart, at 50 mm/s."""
    rows, spreads, illegal = list[tuple[str, ...]](), list[float](), 0
    for case in cases:
        outcomes = [_turn(case, 50.0, spacing) for spacing in SAMPLINGS]
        ratios = [each.ratio for each in outcomes]
        spreads.append(max(ratios) - min(ratios))
        illegal += sum(_is_illegal(each.judged) for each in outcomes)
        seconds = ", ".join(f"{each.seconds:.2f}" for each in outcomes)
        rows.append((case.arm, case.shape, f"{case.angle}°", *(f"{each:.3f}" for each in ratios), seconds))
    figures = (
        Figure(f"of {len(cases)} paths: greatest difference by sampling", max(spreads), "at most", 0.02),
        Figure.none(f"of {3 * len(cases)}: beyond a limit at some sampling", illegal),
    )
    columns = ("arm", "path", "spindle", "0.5 mm", "1 mm", "5 mm", "s")
    return Section("Sampling", columns, tuple(rows), figures)


def _report_placed(cases: Sequence[Case], *, judges: bool) -> Section:
    """Report paths that are placed and turned at 50 mm/s, relative to the path as programmed."""
    rows, refused, passed, illegal = list[tuple[str, ...]](), 0, 0, 0
    ratios = {angle: list[float]() for angle in ANGLES}
    for case in cases:
        path = case.path()
        task = case.task(len(path), 50.0)
        kept = choose_turns(case.known, case.inverse, path, replace(task, angles=np.zeros(1)))
        search = _place(case, path, task)
        passed += search.passed
        if not search.found:
            refused += 1
            continue
        moved, choice = min(search.found, key=lambda each: each[1].size)
        judged = _judge(case, moved, choice.joints, 50.0)
        illegal += _is_illegal(judged)
        ratios[case.angle].append(judged.size / _measure(case, path, kept.joints))
        ratio = f"{ratios[case.angle][-1]:.3f}"
        rows.append((case.arm, case.shape, f"{case.angle}°", ratio, str(search.reached), str(search.passed)))
    places = PLACE_TURNS * int(np.prod(GRID))
    figures = [
        Figure.none(f"of {len(cases)} searches of {places} places: none legal", refused),
        Figure.none(f"of {len(cases)}: placed beyond a limit", illegal),
    ]
    for angle, (_, placed) in REQUIRED.items():
        if judges and ratios[angle]:
            what = f"{angle}°, 50 mm/s: placed and turned / as programmed"
            figures.append(Figure(what, median(ratios[angle]), "at most", placed))
    columns = ("arm", "path", "spindle", "ratio", "reached", "passed over")
    return Section("Placed", columns, tuple(rows), tuple(figures))


@dataclass(frozen=True)
class Search:
    """A search of places."""

    found: list[tuple[ProcessPath, TurnChoice]]  # up to three legal places
    reached: int  # places that the search of few points reaches
    passed: int  # places that were evaluated in full and are not legal


def _place(case: Case, path: ProcessPath, task: TurnTask) -> Search:
    """Search 72 places, and evaluate the best in full until three are legal, as `process` does."""
    turns = 2.0 * np.pi * np.arange(PLACE_TURNS) / PLACE_TURNS
    box = PlaceBox(path.middle - HALF, path.middle + HALF, GRID, turns)
    coarse, coarse_task, first = coarsen(path, task, np.arange(len(path)))
    places = box.places()
    sizes = evaluate_places(case.known, case.inverse, coarse, coarse_task, places, first)
    order = np.argsort(sizes)
    reached = order[np.isfinite(sizes[order])]
    found, passed = list[tuple[ProcessPath, TurnChoice]](), 0
    for i in reached.tolist():
        moved = path.move(places[i, :3] - path.middle, float(places[i, 3]))
        try:
            found.append((moved, choose_turns(case.known, case.inverse, moved, task)))
        except RequestError:
            passed += 1
        if len(found) == 3:
            break
    return Search(found, len(reached), passed)


def _report_times(turned: Sequence[Case], placed: Sequence[Case]) -> Section:
    """Report the processor's time of paths of 2,700 points, turned and placed, and of short ones."""
    rows, seconds = list[tuple[str, ...]](), dict[str, list[float]]()
    for what, cases in (("turned", turned), ("placed", placed), ("40 points", turned)):
        for case in cases:
            length = float(np.linalg.norm(np.diff(case.path().centres, axis=0), axis=1).sum())
            path = case.path(length / (39 if what == "40 points" else MANY - 1))
            task = case.task(len(path), 50.0)
            begin = process_time()
            if what == "placed":
                _place(case, path, task)
            elif what == "turned":
                choose_turns(case.known, case.inverse, path, task)
            else:
                short = TurnTask.free(36, CLEARANCE, task.pace)
                choose_turns(case.known, case.inverse, path, short)
            seconds.setdefault(what, []).append(process_time() - begin)
        greatest = max(seconds[what])
        rows.append((what, str(len(cases)), f"{median(seconds[what]):.2f}", f"{greatest:.2f}"))
    figures = [
        Figure(f"{MANY} points turned, most processor time", max(seconds["turned"]), "at most", 2.0, " s"),
        Figure(f"{MANY} points placed, most processor time", max(seconds["placed"]), "at most", 15.0, " s"),
        Figure("40 points, 36 turns, most processor time", max(seconds["40 points"]), "at most", 1.0, " s"),
    ]
    return Section("Times", ("path", "count", "median s", "greatest s"), tuple(rows), tuple(figures))


def _report_unseen(count: int, *, judges: bool) -> Section:
    """Report how often the true deflection lies in its interval where joints have the arm's prior.

    Stiffnesses are right within the prior's factor of two at 95 %; those that are seen are known to 3 %.
    """
    rows, sizes, differences = list[tuple[str, ...]](), list[bool](), list[bool]()
    for arm in range(len(ARMS)):
        for unseen in UNSEEN:
            held = _cover(arm, unseen, count)
            sizes += held[0]
            differences += held[1]
            names = ", ".join(str(each + 1) for each in unseen)
            rows.append((ARMS[arm], names, *(f"{100.0 * np.mean(each):.1f} %" for each in held)))
    figures = list[Figure]()
    if judges:
        what = f"{len(sizes)} campaigns: the size lies in its interval"
        measured = 100.0 * float(np.mean(sizes))
        figures.append(Figure(what, measured, "at least", 92.5, " %"))
        figures.append(Figure(what, measured, "at most", 97.0, " %"))
        what = f"{len(sizes)} campaigns: the difference lies in its interval"
        figures.append(Figure(what, 100.0 * float(np.mean(differences)), "at least", 93.0, " %"))
    columns = ("arm", "unseen joints", "size", "difference")
    return Section("Unseen joints", columns, tuple(rows), tuple(figures))


def _cover(arm: int, unseen: tuple[int, ...], count: int) -> tuple[list[bool], list[bool]]:
    """Return for campaigns whether size, and difference from the best fixed turn, lie in their intervals."""
    case = _draw_case(arm, "trim", 45)
    draw = np.random.default_rng([arm, *unseen])
    path, robot = case.path(2e-2), case.robot
    prior = build_prior_model(robot).compliance
    seen = np.setdiff1d(np.arange(robot.n), unseen)
    free = Constraints(Bounds.positive(robot.n))
    sizes, differences = list[bool](), list[bool]()
    for _ in range(count):
        truth = prior * np.exp(draw.normal(0.0, 0.5 * np.log(FACTOR), robot.n))
        known = truth * (1.0 + 0.03 * draw.standard_normal(robot.n))
        known[list(unseen)] = 0.0
        covariance = np.diag(np.square(0.03 * known[seen]))
        model = JointModel(robot, known, Likelihood(seen, known[seen], covariance), free)
        filled, _ = assume_unseen_joints(model)
        choice = choose_turns(filled, case.inverse, path, case.task(len(path), 50.0))
        other = choice.joints if choice.best_fixed is None else choice.best_fixed
        ways = [path.cases(np.arange(len(path)), each) for each in (choice.joints, other)]
        exact = JointModel(robot, truth, None, free)
        true = [_root_mean_square(exact, each, path) for each in ways]
        first, second = (PathDeflection.predict(filled, None, each, weights=path.weights) for each in ways)
        sizes.append(_contains(first.band(0.95).readings, true[0]))
        differences.append(_contains(first.compare(second, 0.95).difference.readings, true[0] - true[1]))
    return sizes, differences


def _root_mean_square(model: JointModel, cases: LoadCases, path: ProcessPath) -> float:
    """Return the root mean square of the deflection of a model along a path [m]."""
    return float(np.sqrt(path.weights @ np.square(model.deflect(cases).displacement).sum(axis=1)))


def _contains(interval: tuple[float, float] | None, value: float) -> bool:
    """Return whether an interval contains a value; one of two equal ways has the difference zero."""
    if interval is None:
        return False
    return interval[0] - 1e-15 <= value <= interval[1] + 1e-15
