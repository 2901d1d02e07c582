"""Example clients: their modules, and posts of programs as RoboDK calls them."""

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

CLIENTS = Path(__file__).parents[2] / "examples" / "clients"


def load_client(name: str) -> ModuleType:
    """Import a file of `examples/clients`, which is no package."""
    spec = importlib.util.spec_from_file_location(name, CLIENTS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Mat:
    """A pose as RoboDK passes it: a matrix with its rows."""

    def __init__(self, rows: Any) -> None:
        self.rows = [list(map(float, row)) for row in rows]


class LinePost:
    """A post that writes poses in a frame, as KUKA's do; each call writes its line at once."""

    DIGITS = 4

    def __init__(
        self, robotpost: str = "Line", robotname: str = "arm", robot_axes: int = 6, **_: Any
    ) -> None:
        self.lines: list[str] = []
        self.PROG_EXT = "src"

    def ProgStart(self, name: str) -> None:
        self.lines.append(f"DEF {name}()")

    def ProgFinish(self, _name: str) -> None:
        self.lines.append("END")

    def _pose(self, pose: Mat) -> str:
        matrix = np.array(pose.rows)
        angles = Rotation.from_matrix(matrix[:3, :3]).as_euler("ZYX", degrees=True)
        return ", ".join(f"{each:.{self.DIGITS}f}" for each in [*matrix[:3, 3], *angles])

    def setFrame(self, pose: Mat, frame_id: int | None = None, name: str | None = None) -> None:
        self.lines.append(f"BASE {{{self._pose(pose)}}}")

    def setTool(self, pose: Mat, tool_id: int | None = None, name: str | None = None) -> None:
        self.lines.append(f"TOOL {{{self._pose(pose)}}}")

    def setSpeed(self, speed: float) -> None:
        self.lines.append(f"VEL {speed:.1f}")

    def RunCode(self, code: str, is_call: bool = False) -> None:
        self.lines.append(f"{code}()")

    def RunMessage(self, message: str, is_comment: bool = False) -> None:
        self.lines.append(f"; {message}")

    def MoveJ(self, pose: Mat | None, joints: list[float], conf_RLF: Any = None) -> None:
        self.lines.append("PTP {" + ", ".join(f"{each:.4f}" for each in joints) + "}")

    def MoveL(self, pose: Mat | None, joints: list[float], conf_RLF: Any = None) -> None:
        self.lines.append("PTP_LIN" if pose is None else f"LIN {{{self._pose(pose)}}}")

    def MoveC(
        self, pose1: Mat, joints1: list[float], pose2: Mat, joints2: list[float], *_configurations: Any
    ) -> None:
        self.lines.append(f"CIRC {{{self._pose(pose1)}}}, {{{self._pose(pose2)}}}")


class JointPost(LinePost):
    """A post that writes joints, and keeps its lines in another attribute until the program ends."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.text = ""

    def MoveL(self, pose: Mat | None, joints: list[float], conf_RLF: Any = None) -> None:
        self.lines.append("MoveJ [" + ", ".join(f"{each:.6f}" for each in joints) + "]")

    def ProgFinish(self, name: str) -> None:
        super().ProgFinish(name)
        self.text = "\n".join(self.lines)
