"""Expand files of xacro by their package, in a process of its own with limits.

Expressions of xacro are Python: `${9**9**9}` never ends, and macros may call themselves. ROS need not be
installed: `$(find PACKAGE)` is the folder whose `package.xml` has that name. This folder contains the file,
is next to the package that contains the file, or is in a folder of `ROS_PACKAGE_PATH`.
`python -P -m jointstiff.service.conversion.xacro FILE` writes one JSON document.
"""

from __future__ import annotations

import json
import os
import re
import sys
from contextlib import redirect_stdout
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from jointstiff.service.conversion.child import MAX_MEMORY, ask_child, limit_this_process
from jointstiff.solver.errors import RobotError

MAX_SECONDS: Final = 5
"""Processor time of the process that expands a file [s]; files of arms need less than one."""
_MAX_BYTES: Final = 64 * 1024 * 1024
"""Characters of an expanded file."""
_MAX_REASON: Final = 300
"""Characters of a reason that the package gives."""
_MANIFEST: Final = "package.xml"
_CHECK: Final = (
    "check the file with the program xacro; set ROS_PACKAGE_PATH to the folder that contains the packages of "
    "$(find PACKAGE), and give each argument a default"
)


def expand_xacro(path: Path) -> str:
    """Return the URDF of a xacro file, by the package `xacro`.

    Raises:
        RobotError: the package is not installed, the file cannot be expanded, or this takes too much memory
            or time.
    """
    if find_spec("xacro") is None:
        raise RobotError(
            "a xacro file needs the package xacro, which is not installed",
            where="robot",
            remedy="pip install xacro, or expand the file first: xacro robot.urdf.xacro > robot.urdf",
        )
    answer = ask_child("jointstiff.service.conversion.xacro", str(path))
    if answer.document is None:
        error = f" ({answer.error})" if answer.error else ""
        raise RobotError(
            f"the expansion of the xacro file gave no result{error}: it needs more than {MAX_SECONDS} s or "
            f"{MAX_MEMORY >> 20} MiB",
            where="robot",
            remedy="look for an expression that calculates without end, or a macro that calls itself",
        )
    if "reason" in answer.document:
        reason = f"the xacro file cannot be expanded: {answer.document['reason']}"
        raise RobotError(reason, where="robot", remedy=_CHECK)
    return str(answer.document["urdf"])


def main(file: str) -> dict[str, Any] | None:
    """Return the URDF of a xacro file, or the reason why there is none; None if it takes too much memory."""
    import xacro

    _offer_packages(Path(file).resolve())
    limit_this_process(MAX_SECONDS)
    try:
        with redirect_stdout(sys.stderr):  # which has the remarks of the package
            urdf = str(xacro.process_file(file).toxml())
    except MemoryError:
        return None
    except Exception as error:  # noqa: BLE001 - the package raises errors of many kinds
        return {"reason": str(error)[:_MAX_REASON] or type(error).__name__}
    return {"urdf": urdf} if len(urdf) <= _MAX_BYTES else None


def _offer_packages(file: Path) -> None:
    """Offer packages to `xacro`, which asks the module `ament_index_python.packages` of ROS 2 for them."""
    module = ModuleType("ament_index_python.packages")
    vars(module)["get_package_share_directory"] = partial(find_package, file)
    sys.modules["ament_index_python"] = ModuleType("ament_index_python")
    sys.modules["ament_index_python.packages"] = module


def find_package(file: Path, name: str) -> str:
    """Return the folder of a package that a file names, without ROS.

    Args:
        file: absolute path of the file that names the package.
        name: name of the package, in its `package.xml`.

    Raises:
        LookupError: no folder is that of the package.
    """
    paths = [Path(each) for each in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if each]
    packages = [folder for folder in file.parents if (folder / _MANIFEST).is_file()]
    packages += [found.parent for folder in packages for found in folder.parent.glob(f"*/{_MANIFEST}")]
    packages += [folder for path in paths for folder in (path, *path.glob("*/"), *path.glob("*/*/"))]
    for folder in packages:
        if _read_package_name(folder / _MANIFEST) == name:
            return str(folder)
    raise LookupError(f"no folder has the package {name!r}")


def _read_package_name(manifest: Path) -> str | None:
    """Return the name in the file `package.xml` of a package; None without it."""
    if not manifest.is_file():
        return None
    found = re.search(r"<name>\s*([\w.-]+)\s*</name>", manifest.read_text(encoding="utf-8", errors="replace"))
    return None if found is None else found[1]


if __name__ == "__main__":
    sys.stdout.write(json.dumps(main(sys.argv[1])))
