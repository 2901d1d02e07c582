"""Posts of RoboDK whose programs are corrected for the deflection under load.

`corrected(RobotPost, …)` returns a class that records the calls of a program, sends all targets at once to a
Jointstiff service, and replays the calls with corrected targets through the post's own methods. It needs only
the standard library of RoboDK's Python. A post with three lines, for a post `KUKA_KRC4`:

    from KUKA_KRC4 import *
    from robodk_mixin import corrected
    RobotPost = corrected(RobotPost, "http://127.0.0.1:8000", run_id="…", force=(0, 0, -500), axes="tool")

The load acts on linear and circular moves between `RunCode("CUT_ON")` and `RunCode("CUT_OFF")`; in a program
without these calls, on all of them. Joint moves and targets without a pose are left as they are.
"""

import json
import math
import urllib.error
import urllib.request

RECORDED = (
    "MoveJ",
    "MoveL",
    "MoveC",
    "setFrame",
    "setTool",
    "Pause",
    "setSpeed",
    "setAcceleration",
    "setSpeedJoints",
    "setAccelerationJoints",
    "setZoneData",
    "setDO",
    "setAO",
    "waitDI",
    "RunCode",
    "RunMessage",
)
"""Methods of a post that write into the program, in the order in which RoboDK calls them."""
_IDENTITY = [[float(i == j) for j in range(4)] for i in range(4)]
_MOVED = {"corrected", "capped"}
_KEPT = {"no_load", "uncertain"}


class CorrectionError(Exception):
    """Error that a program cannot be corrected; no program is written."""


def send(url, body, key=None):
    """Post a request of corrections to a service, and return its answer."""
    headers = {"Content-Type": "application/json"}
    if key:
        headers["Authorization"] = "Bearer " + key
    request = urllib.request.Request(url + "/v1/corrections", json.dumps(body).encode(), headers)
    try:
        with urllib.request.urlopen(request, timeout=300) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        problem = json.loads(error.read().decode() or "{}")
        reason = problem.get("detail", "the service answers %d" % error.code)
        raise CorrectionError("%s; remedy: %s" % (reason, problem.get("remedy", "see the service"))) from None


class _Row:
    """A target of a recorded call: its pose and joints, and the frames in which they were programmed."""

    def __init__(self, call, place, frame, tool, is_loaded):
        self.call, self.place, self.frame, self.tool, self.is_loaded = call, place, frame, tool, is_loaded

    @property
    def pose(self):
        """Pose of the tool in the robot's base."""
        return _multiply(self.frame, _rows(self.call[1][self.place]))

    def replace(self, pose, joints):
        """Replace the target of the call by a corrected pose in the robot's base, and joints."""
        arguments = self.call[1]
        arguments[self.place] = type(arguments[self.place])(_multiply(_invert(self.frame), pose))
        external = list(_flat(arguments[self.place + 1]))[len(joints) :]
        arguments[self.place + 1] = joints + external


def corrected(post, url="", key=None, transport=None, start=("CUT_ON",), stop=("CUT_OFF",), **options):
    """Return the class of a post whose programs are corrected.

    Args:
        post: class of the post.
        url: address of the service.
        key: access key of the service.
        transport: function from a request to its answer, in place of HTTP.
        start: names of `RunCode` after which the load acts.
        stop: names of `RunCode` after which it does not.
        options: `run_id` or `robot_id`; `force` (3,) [N] along `axes` (`robot`, `base`, `tool`), as of
            `POST /v1/corrections`; `joints`, the number of the robot's joints (6); `leave_others`, to
            keep targets that cannot be corrected.
    """
    post_request = transport or (lambda body: send(url, body, key))
    force, axes = tuple(options.pop("force")), options.pop("axes", "robot")
    joint_count, leaves_others = options.pop("joints", 6), options.pop("leave_others", False)

    class Corrected(post):
        """The post, with corrected targets."""

        def __init__(self, *arguments, **named):
            self._recorded_calls = (
                None  # recorded calls (name, arguments, named arguments) of the open program
            )
            self._recorded_frame, self._recorded_tool = _IDENTITY, _IDENTITY
            super().__init__(*arguments, **named)

        def ProgStart(self, *arguments, **named):
            """Begin a program: the calls that follow are recorded."""
            super().ProgStart(*arguments, **named)
            self._recorded_calls = []

        def ProgFinish(self, *arguments, **named):
            """Correct the targets of the recorded calls, replay the calls, and end the program."""
            calls, self._recorded_calls = self._recorded_calls or [], None
            rows = self._collect_rows(calls)
            summary = _correct_rows(rows, post_request, options, force, axes, joint_count, leaves_others)
            if summary:
                super().RunMessage("Jointstiff: " + summary, True)
            for name, positional, keywords in calls:
                getattr(super(), name)(*positional, **keywords)
            super().ProgFinish(*arguments, **named)

        def _collect_rows(self, calls):
            """Return the targets of linear and circular moves, with the frames that hold there."""
            names = [str(positional[0]) for name, positional, _ in calls if name == "RunCode" and positional]
            is_loaded = not any(name in start for name in names)
            rows = []
            for call in calls:
                name, positional, _ = call
                if name == "setFrame":
                    self._recorded_frame = _rows(positional[0])
                elif name == "setTool":
                    self._recorded_tool = _rows(positional[0])
                elif name == "RunCode" and positional and str(positional[0]) in start:
                    is_loaded = True
                elif name == "RunCode" and positional and str(positional[0]) in stop:
                    is_loaded = False
                elif name in ("MoveL", "MoveC"):
                    places = (0,) if name == "MoveL" else (0, 2)
                    known = [place for place in places if positional[place] is not None]
                    rows += [
                        _Row(call, place, self._recorded_frame, self._recorded_tool, is_loaded)
                        for place in known
                    ]
            return rows

    def make_recorder(name):
        def record(self, *arguments, **named):
            if self._recorded_calls is not None:
                self._recorded_calls.append((name, list(arguments), dict(named)))
                return None
            if name == "setFrame":
                self._recorded_frame = _rows(arguments[0])
            elif name == "setTool":
                self._recorded_tool = _rows(arguments[0])
            return getattr(super(Corrected, self), name)(*arguments, **named)

        record.__name__, record.__doc__ = name, "Record the call, if a program is open."
        return record

    for name in RECORDED:
        if hasattr(post, name):
            setattr(Corrected, name, make_recorder(name))
    Corrected.__name__ = Corrected.__qualname__ = post.__name__
    return Corrected


def _correct_rows(rows, post_request, options, force, axes, joint_count, leaves_others):
    """Replace the targets of rows by corrected ones; return a summary, empty if nothing was sent."""
    counts = {}
    loaded_tools = [row.tool for row in rows if row.is_loaded and any(force)]
    for tool in [each for i, each in enumerate(loaded_tools) if each not in loaded_tools[:i]]:
        chosen = [row for row in rows if row.tool == tool]
        body = dict(options, units={"length": "mm", "angle": "deg", "force": "N"})
        body["tool"] = [tool[i][3] for i in range(3)] + _rotation_vector(tool)
        body["columns"] = _list_columns(chosen, force, axes, joint_count)
        columns = post_request(body)["columns"]
        for i, row in enumerate(chosen):
            status = columns["status"][i]
            counts[status] = counts.get(status, 0) + 1
            if status in _MOVED:
                pose = _pose([columns[name][i] for name in ("x", "y", "z", "q1", "q2", "q3", "q4")])
                row.replace(pose, [columns["j%d" % (j + 1)][i] for j in range(joint_count)])
    faults = sorted(set(counts) - _MOVED - _KEPT)
    summary = ", ".join("%d targets %s" % (counts[each], each) for each in sorted(counts))
    if faults and not leaves_others:
        raise CorrectionError(summary + "; state leave_others=True to keep those that are not corrected")
    return summary


def _list_columns(rows, force, axes, joint_count):
    """Return the columns of a request for rows of one tool."""
    names = ["x", "y", "z", "q1", "q2", "q3", "q4"]
    names += ["j%d" % (j + 1) for j in range(joint_count)] + ["fx", "fy", "fz"]
    columns = {name: [] for name in names}
    for row in rows:
        pose = row.pose
        load_axes = {"robot": _IDENTITY, "base": row.frame, "tool": pose}[axes]
        load = [sum(load_axes[i][k] * force[k] for k in range(3)) for i in range(3)]
        joints = [float(each) for each in _flat(row.call[1][row.place + 1])][:joint_count]
        numbers = [pose[i][3] for i in range(3)] + _quaternion(pose) + joints
        numbers += load if row.is_loaded else [0.0, 0.0, 0.0]
        for name, number in zip(names, numbers):
            columns[name].append(number)
    return columns


def _rows(pose):
    """Return the rows of a pose: a `Mat` of RoboDK, or a list of rows."""
    rows = getattr(pose, "rows", pose)
    return [[float(each) for each in row] for row in (rows() if callable(rows) else rows)]


def _flat(joints):
    """Return joints as one list: RoboDK passes a list, or a `Mat` of one column."""
    listed = joints.list() if hasattr(joints, "list") else joints
    return [each[0] if isinstance(each, list) else each for each in listed]


def _multiply(a, b):
    """Return the product of two poses."""
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def _invert(pose):
    """Return the inverse of a pose."""
    turned = [[pose[j][i] for j in range(3)] for i in range(3)]
    shift = [-sum(turned[i][k] * pose[k][3] for k in range(3)) for i in range(3)]
    return [turned[i] + [shift[i]] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]]


def _quaternion(pose):
    """Return the unit quaternion of a pose, scalar first (Shepperd's choice of the greatest component)."""
    (a, b, c), (d, e, f), (g, h, i) = (row[:3] for row in pose[:3])
    squares = [1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i]
    greatest = squares.index(max(squares))
    products = [
        [squares[0], h - f, c - g, d - b],
        [h - f, squares[1], b + d, c + g],
        [c - g, b + d, squares[2], f + h],
        [d - b, c + g, f + h, squares[3]],
    ][greatest]
    size = math.sqrt(sum(each * each for each in products))
    return [each / size for each in products]


def _rotation_vector(pose):
    """Return the rotation vector of a pose [deg]."""
    w, x, y, z = _quaternion(pose)
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < 1e-15:
        return [0.0, 0.0, 0.0]
    angle = 2.0 * math.degrees(math.atan2(sine, w)) / sine
    return [angle * x, angle * y, angle * z]


def _pose(numbers):
    """Return the pose of X, Y, Z and a quaternion."""
    x, y, z, w, i, j, k = numbers
    return [
        [1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w), x],
        [2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w), y],
        [2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j), z],
        [0.0, 0.0, 0.0, 1.0],
    ]
