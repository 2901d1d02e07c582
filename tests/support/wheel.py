"""The wheels of this repository, and an environment that has the packages from them and nowhere else."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def uv() -> str:
    """Return the program, or skip the test."""
    found = shutil.which("uv", path=os.pathsep.join([os.environ["PATH"], str(ROOT / ".tools" / "bin")]))
    return found or pytest.skip("uv is not there; scripts/setup fetches it")


def run(*command: str, **options) -> subprocess.CompletedProcess[str]:
    """Run a command that must succeed."""
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=240, **options)
    assert done.returncode == 0, done.stderr[-2000:]
    return done


def build(folder: Path) -> None:
    """Build the wheels of jointstiff and robotprograms into a folder."""
    run(uv(), "build", "--quiet", "--all-packages", "--wheel", "--out-dir", str(folder), str(ROOT))


def install(folder: Path, environment: Path) -> None:
    """Make an environment with the wheels of a folder; it has the dependencies of this Python alone."""
    run(uv(), "venv", "--quiet", "--python", sys.executable, str(environment))
    python = environment / "bin" / "python"
    run(
        uv(),
        "pip",
        "install",
        "--quiet",
        "--python",
        str(python),
        "--no-deps",
        *map(str, folder.glob("*.whl")),
    )
    (own,) = environment.glob("lib/python*/site-packages")
    inside = [path for path in sys.path if "site-packages" in Path(path).parts and Path(path).is_dir()]
    (own / "dependencies.pth").write_text("".join(f"{path}\n" for path in inside))
    place = run(str(python), "-P", "-c", "import jointstiff; print(jointstiff.__file__)").stdout
    assert Path(place).is_relative_to(own), f"not the wheel's package: {place}"


def install_bare(wheel: Path, environment: Path, python: str) -> None:
    """Make an environment with the wheel and its own dependencies, in the versions of the lock file."""
    run(uv(), "venv", "--quiet", "--clear", "--python", python, str(environment))
    locked = environment / "constraints.txt"
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    locked.write_text("\n".join(line.rstrip(" \\") for line in lines if "==" in line and line[0] != " "))
    # EAIK names it for what we do not use; see [tool.uv] in pyproject.toml.
    override = environment / "overrides.txt"
    override.write_text("urchin; python_version < '3'")
    install = (
        uv(),
        "pip",
        "install",
        "--quiet",
        "--no-config",
        "--python",
        str(environment / "bin" / "python"),
    )
    run(*install, "--constraint", str(locked), "--override", str(override), str(wheel))


def newest_python() -> str:
    """Return the newest Python of this system that the package supports, or skip the test."""
    folders = [Path("/usr/bin"), Path("/usr/local/bin")]
    folders += (Path.home() / ".pyenv" / "versions").glob("3.*/bin")
    for minor in (14, 13, 12):
        for folder in folders:
            if (python := folder / f"python3.{minor}").exists():
                return str(python)
    return pytest.skip("there is no Python newer than 3.11 here")
