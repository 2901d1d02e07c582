"""Filter of APT files (CLS): corrects the points of GOTO for the deflection under load.

    python apt_filter.py part.cls run.json --force 0,0,-500 --tool 0,0,200,0,0,0 --turn 1,0,0 -o corrected.cls

An APT file states a point and the axis of the tool, but neither the turn about this axis, nor the posture of
the arm, nor base and tool: the caller states them (`turn`, `start`, `base`, `tool`). The correction is right
only if the post turns the tool by the same rule: x of the tool as near to a fixed direction as its axis
allows, or to the feed. For a spindle along the last axis of the arm the turn does not matter. Lines that move
the tool in a way that this filter does not follow are refused. RoboDK reads APT files, and knows the turn:
then use `robodk_mixin.py`.
"""

import argparse
import re
from pathlib import Path

import numpy as np

NOT_FOLLOWED = [
    "ARC",
    "CIRCLE",
    "COPY",
    "CUTCOM",
    "CYCLE",
    "GODLTA",
    "GOHOME",
    "HELIX",
    "INDEX",
    "NURBS",
    "ROTABL",
    "ROTATE",
    "ROTHED",
    "SPLINE",
    "TRACUT",
    "TRANS",
]
"""Words that move the tool, or transform its points, in a way that is not followed."""
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?")
_INCH = 25.4
_LEAST_SINE = 1e-6


class Point:
    """A point of a GOTO or FROM, in mm, in the system of the machine."""

    def __init__(self, line, last_line, word, numbers, axis, system, unit, is_rapid):
        self.line, self.last_line, self.word, self.is_rapid = line, last_line, word, is_rapid
        self.system, self.unit, self.count = system, unit, len(numbers)
        self.place = system[:3, :3] @ (unit * np.array(numbers[:3])) + system[:3, 3]
        self.axis = system[:3, :3] @ axis

    def write(self, pose, digits=4):
        """Return the statement with the place and the axis of a corrected pose [mm]."""
        turned = self.system[:3, :3].T
        place = turned @ (pose[:3, 3] - self.system[:3, 3]) / self.unit
        numbers = [f"{each:.{digits}f}" for each in place]
        if self.count == 6:
            numbers += [f"{each:.7f}" for each in -turned @ pose[:3, 2]]
        return f"{self.word}/{','.join(numbers)}"


def read_points(text):
    """Return the points of an APT file, in order.

    Raises:
        ValueError: a line moves the tool in a way that is not followed.
    """
    lines, points = text.splitlines(), []
    unit, system, axis, is_rapid = 1.0, np.eye(4), np.array([0.0, 0.0, 1.0]), False
    for first, last, statement in _join_lines(lines):
        word, _, body = statement.partition("/")
        word = word.strip().upper()
        numbers = [float(each.replace("D", "E").replace("d", "e")) for each in _NUMBER.findall(body)]
        if word in NOT_FOLLOWED:
            raise ValueError(f"line {first + 1}: {word} is not followed; post the path as lines (GOTO)")
        if word == "UNITS":
            unit = _INCH if "INCH" in body.upper() else 1.0
        elif word == "RAPID":
            is_rapid = True
        elif word == "MSYS":
            system = _read_system(numbers, unit, first)
        elif word == "TLAXIS" and len(numbers) == 3:
            axis = np.array(numbers)
        elif word in ("GOTO", "FROM"):
            if len(numbers) not in (3, 6):
                raise ValueError(f"line {first + 1}: {word} needs 3 or 6 numbers")
            if len(numbers) == 6:
                axis = np.array(numbers[3:])
            rapid = is_rapid or word == "FROM"
            points.append(Point(first, last, word, numbers, axis, system, unit, rapid))
            is_rapid = False
    return points


def _join_lines(lines):
    """Yield first line, last line and text of each statement; `$` at the end of a line continues it."""
    k = 0
    while k < len(lines):
        first, statement = k, lines[k]
        while statement.rstrip().endswith("$") and k + 1 < len(lines):
            k += 1
            statement = statement.rstrip()[:-1] + lines[k]
        k += 1
        if not statement.lstrip().startswith("$$"):
            yield first, k - 1, statement


def _read_system(numbers, unit, line):
    """Return the pose of a system of coordinates from origin, x axis and y axis."""
    if len(numbers) != 9:
        raise ValueError(f"line {line + 1}: MSYS needs 9 numbers")
    system = np.eye(4)
    x, y = np.array(numbers[3:6]), np.array(numbers[6:9])
    system[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
    system[:3, 3] = unit * np.array(numbers[:3])
    return system


def make_poses(points, turn):
    """Return poses (N, 4, 4) of the tool: z from spindle to tip, x near `turn` [mm]."""
    places = np.array([point.place for point in points])
    feeds = np.gradient(places, axis=0) if len(points) > 1 else np.tile([1.0, 0.0, 0.0], (1, 1))
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    for pose, point, feed in zip(poses, points, feeds):
        z = -point.axis / np.linalg.norm(point.axis)
        x = np.array(feed if isinstance(turn, str) else turn, dtype=float)
        x = x - z * (x @ z)
        if np.linalg.norm(x) < _LEAST_SINE:
            raise ValueError(f"line {point.line + 1}: `turn` is along the tool's axis; state another one")
        x = x / np.linalg.norm(x)
        pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
        pose[:3, 3] = point.place
    return poses


def correct_apt(text, correct, force, turn=(1.0, 0.0, 0.0)):
    """Return an APT file with corrected points.

    Args:
        text: the file.
        correct: function from poses (N, 4, 4) [mm] and forces (N, 3) [N] to a `jointstiff.Correction`.
        force: force on the tool [N], along the axes that `correct` states.
        turn: direction of the tool's x axis in the machine's system, or "feed".

    Raises:
        ValueError: a line is not followed, or a point cannot be corrected.
    """
    points = read_points(text)
    forces = np.array([np.zeros(3) if point.is_rapid else np.array(force, dtype=float) for point in points])
    done = correct(make_poses(points, turn), forces)
    lines, written = text.splitlines(), {}
    for point, pose, status in zip(points, done.poses, done.status):
        if status in ("corrected", "capped"):
            in_mm = pose.copy()
            in_mm[:3, 3] *= 1e3  # the arrays of a correction are in m
            written[point.line] = (point.last_line, point.write(in_mm))
        elif status not in ("no_load", "uncertain"):
            raise ValueError(f"line {point.line + 1}: the point is {status.replace('_', ' ')}")
    result, k = [], 0
    while k < len(lines):
        last, line = written.get(k, (k, lines[k]))
        result.append(line)
        k = last + 1
    return "\n".join(result) + "\n"


def main():
    """Correct a file by a run that `jointstiff identify --save` wrote."""
    import jointstiff

    def numbers(text):
        return [float(each) for each in text.split(",")]

    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("run")
    parser.add_argument("--force", type=numbers, required=True, help="X,Y,Z [N]")
    parser.add_argument("--axes", default="robot", choices=["robot", "base", "tool", "feed"])
    parser.add_argument("--tool", type=numbers, help="X,Y,Z [mm], rotation vector [deg]")
    parser.add_argument("--base", type=numbers, help="X,Y,Z [mm], rotation vector [deg]")
    parser.add_argument("--start", type=numbers, required=True, help="joints near the first point [deg]")
    parser.add_argument("--turn", default="1,0,0", help="direction of the tool's x axis, or feed")
    parser.add_argument("-o", "--output", type=Path, required=True)
    stated = parser.parse_args()
    run = jointstiff.load(stated.run)
    frames = {"tool": stated.tool, "base": stated.base, "start": stated.start, "axes": stated.axes}

    def correct(poses, forces):
        return run.correct(poses, forces=forces, **frames)

    turn = stated.turn if stated.turn == "feed" else numbers(stated.turn)
    stated.output.write_text(correct_apt(stated.file.read_text(), correct, stated.force, turn))


if __name__ == "__main__":
    main()
