"""Programs through given poses, in the forms of the makers' manuals.

Their numbers come from formulas of their own, so that what reads them can be compared with what was meant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from jointstiff.simulator.arm import FloatArray

__all__ = ["PROGRAM_FILES", "program_text"]

PROGRAM_FILES: Mapping[str, str] = MappingProxyType(
    {
        "csv": "path.csv",
        "krl": "path.src",
        "fanuc": "PATH.LS",
        "rapid": "Path.mod",
        "ur": "path.script",
    }
)
"""Name of a file of each format."""


def program_text(kind: str, poses: FloatArray, decimals: int = 4) -> str:
    """Return a program of linear moves through poses.

    Args:
        kind: format, a key of PROGRAM_FILES.
        poses: (m, 4, 4) of the tool in the base [m].
        decimals: digits behind the point of millimetres; metres and radians get three more, degrees one,
            numbers without a unit four.
    """
    return _WRITERS[kind](poses, decimals)


def _krl(poses: FloatArray, d: int) -> str:
    moves = (
        f"LIN {{X {x:.{d}f},Y {y:.{d}f},Z {z:.{d}f},A {a:.{d + 1}f},B {b:.{d + 1}f},C {c:.{d + 1}f}}} C_DIS"
        for x, y, z, a, b, c in _with_angles(poses)
    )
    head = ["&ACCESS RVP", "DEF path()", ";FOLD INI", ";ENDFOLD", "$TOOL=TOOL_DATA[1]", "$BASE=BASE_DATA[1]"]
    return "\r\n".join([*head, *moves, "END", ""])


def _fanuc(poses: FloatArray, d: int) -> str:
    count = len(poses)
    moves = [f"{i + 1:4d}:L P[{i + 1}] 50mm/sec CNT100    ;" for i in range(count)]
    positions = [
        f"P[{i + 1}]{{\n   GP1:\n\tUF : 1, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n"
        f"\tX = {x:{d + 6}.{d}f}  mm,\tY = {y:{d + 6}.{d}f}  mm,\tZ = {z:{d + 6}.{d}f}  mm,\n"
        f"\tW = {w:{d + 6}.{d + 1}f} deg,\tP = {p:{d + 6}.{d + 1}f} deg,\tR = {r:{d + 6}.{d + 1}f} deg\n}};"
        for i, (x, y, z, r, p, w) in enumerate(_with_angles(poses))
    ]
    head = ["/PROG  PATH", "/ATTR", "DEFAULT_GROUP\t= 1,*,*,*,*;", "/MN"]
    return "\n".join([*head, *moves, "/POS", *positions, "/END", ""])


def _rapid(poses: FloatArray, d: int) -> str:
    moves = (
        f"    MoveL [[{x:.{d}f},{y:.{d}f},{z:.{d}f}],[{','.join(f'{v:.{d + 4}f}' for v in q)}],[0,0,0,0],"
        "[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]],v50,z1,tMill\\WObj:=wPart;"
        for (x, y, z), q in zip(1e3 * poses[:, :3, 3], _quaternions(poses), strict=True)
    )
    head = ["MODULE Path", "  PROC main()", "    ConfL\\Off;"]
    return "\n".join([*head, *moves, "  ENDPROC", "ENDMODULE", ""])


def _ur(poses: FloatArray, d: int) -> str:
    vectors = _rotation_vectors(poses)
    moves = (
        f"  movel(p[{', '.join(f'{v:.{d + 3}f}' for v in (*place, *vector))}], a=1.2, v=0.05, r=0.001)"
        for place, vector in zip(poses[:, :3, 3], vectors, strict=True)
    )
    return "\n".join(["def path():", *moves, "end", ""])


def _csv(poses: FloatArray, d: int) -> str:
    rows = (
        f"{i + 1};{x:.{d}f};{y:.{d}f};{z:.{d}f};{a:.{d + 1}f};{b:.{d + 1}f};{c:.{d + 1}f}"
        for i, (x, y, z, a, b, c) in enumerate(_with_angles(poses))
    )
    return "\n".join(["n;x [mm];y [mm];z [mm];a [deg];b [deg];c [deg]", *rows, ""])


def _with_angles(poses: FloatArray) -> FloatArray:
    """Return x, y, z [mm] and the angles about Z, Y', X'' [°]."""
    R = poses[:, :3, :3]
    middle = np.arctan2(-R[:, 2, 0], np.hypot(R[:, 0, 0], R[:, 1, 0]))
    first, last = np.arctan2(R[:, 1, 0], R[:, 0, 0]), np.arctan2(R[:, 2, 1], R[:, 2, 2])
    return np.column_stack([1e3 * poses[:, :3, 3], np.degrees(np.column_stack([first, middle, last]))])


def _rotation_vectors(poses: FloatArray) -> FloatArray:
    q = _quaternions(poses)
    sine = np.linalg.norm(q[:, 1:], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[:, :1])
    return np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 2.0) * q[:, 1:]


def _quaternions(poses: FloatArray) -> FloatArray:
    """Return quaternions, scalar first and not negative, by the row of the largest component."""
    R = poses[:, :3, :3]
    x, y, z = R[:, :, 0].T, R[:, :, 1].T, R[:, :, 2].T
    K = np.empty((len(R), 4, 4))
    K[:, 0] = np.column_stack([1 + x[0] + y[1] + z[2], y[2] - z[1], z[0] - x[2], x[1] - y[0]])
    K[:, 1] = np.column_stack([y[2] - z[1], 1 + x[0] - y[1] - z[2], x[1] + y[0], z[0] + x[2]])
    K[:, 2] = np.column_stack([z[0] - x[2], x[1] + y[0], 1 - x[0] + y[1] - z[2], y[2] + z[1]])
    K[:, 3] = np.column_stack([x[1] - y[0], z[0] + x[2], y[2] + z[1], 1 - x[0] - y[1] + z[2]])
    best = np.argmax(np.einsum("bii->bi", K), axis=1)
    q: FloatArray = K[np.arange(len(R)), best]
    q = np.copysign(1.0, q[:, :1]) * q / np.linalg.norm(q, axis=1, keepdims=True)
    return np.asarray(q)


_WRITERS: Mapping[str, Callable[[FloatArray, int], str]] = MappingProxyType(
    {"csv": _csv, "krl": _krl, "fanuc": _fanuc, "rapid": _rapid, "ur": _ur}
)
