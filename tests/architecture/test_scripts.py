"""Scripts for developers: help without a set-up, and an error without a browser."""

import subprocess
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"


def run(script, *arguments, path):
    return subprocess.run(
        [SCRIPTS / script, *arguments],
        env={"PATH": str(path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def folder_of_programs(folder, *names):
    """Return a folder with the named programs of this system, for PATH."""
    folder.mkdir()
    for name in names:
        (folder / name).symlink_to(f"/usr/bin/{name}")
    return folder


@pytest.mark.process
@pytest.mark.parametrize("script", ["run", "setup", "test"])
@pytest.mark.parametrize("option", ["--help", "-h"])
def test_help_is_shown_and_nothing_is_installed(tmp_path, script, option):
    shown = run(script, option, path=folder_of_programs(tmp_path / "bin", "sed"))
    assert shown.returncode == 0, shown.stderr
    assert f"usage: scripts/{script}" in shown.stdout
    assert shown.stderr == ""


@pytest.mark.process
def test_without_a_browser_the_set_up_of_one_fails_and_says_so(tmp_path):
    refused = run("chromium", path=folder_of_programs(tmp_path / "bin", "id"))
    assert refused.returncode == 1
    assert "no Chromium" in refused.stderr
    assert refused.stdout == ""


@pytest.mark.process
def test_a_browser_that_does_not_start_is_none(tmp_path):
    programs = folder_of_programs(tmp_path / "bin", "id")
    (programs / "chromium").write_text("#!/bin/sh\nexit 1\n")
    (programs / "chromium").chmod(0o700)
    assert run("chromium", path=programs).returncode == 1


@pytest.mark.process
def test_an_installed_browser_is_named(tmp_path):
    programs = folder_of_programs(tmp_path / "bin", "id")
    (programs / "chromium").write_text("#!/bin/sh\nexit 0\n")
    (programs / "chromium").chmod(0o700)
    found = run("chromium", path=programs)
    assert (found.returncode, found.stdout) == (0, f"{programs}/chromium\n")
