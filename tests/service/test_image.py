"""What the package is built from reaches the image; Docker leaves out what `.dockerignore` does not name."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WHEEL = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
HOOK = WHEEL["hooks"]["custom"].get("path", "hatch_build.py")
NEEDED = [
    *(name.split("/")[0] for name in WHEEL["only-include"]),
    HOOK,
    "dashboard",
    PROJECT["project"]["readme"],
    *PROJECT["project"]["license-files"],
    "pyproject.toml",
    "requirements.lock",
    "requirements-docs.lock",
    "docs",
    "docker/README.md",
    "CHANGELOG.md",
    "docker/build.lock",
]


@pytest.mark.parametrize("name", NEEDED)
def test_what_the_wheel_is_built_from_reaches_the_image(name):
    lines = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert (ROOT / name).exists()
    assert f"!{name}" in lines
