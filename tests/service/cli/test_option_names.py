"""Texts that advise an option name one that a command has."""

import re
from pathlib import Path

import pytest
from support.terminal import terminal
from typer.main import get_command

import jointstiff
from jointstiff.service.cli.app import app
from jointstiff.service.cli.kinds import name_options_in_text
from jointstiff.service.kinds.rooms import ROOMS, import_kind

PACKAGE = Path(jointstiff.__file__).parent
OF_OTHERS = {"--publish", "--file", "--format"}
"""Options of Docker and of pg_restore that our texts name."""
NAMED = re.compile(r"(?<![\w-])--[a-z][a-z-]*[a-z](?![\w-])")


def commands():
    """Every command with its name, those of groups, too."""
    group = get_command(app)
    for name in group.list_commands(None):
        _, command, _ = group.resolve_command(None, [name])
        for each in getattr(command, "commands", {"": command}).values():
            yield f"{name} {each.name}", each


def options_of(command):
    return {flag for each in command.params for flag in [*each.opts, *each.secondary_opts]} | {"--help"}


OPTIONS = {name: options_of(command) for name, command in commands()}


def sources():
    folders = ("schemas", "service", "solver")
    return [path for folder in folders for path in sorted((PACKAGE / folder).rglob("*.py"))]


def test_every_option_that_a_text_names_exists():
    known = set().union(*OPTIONS.values()) | {"--version"} | OF_OTHERS
    named = {(flag, path.name) for path in sources() for flag in NAMED.findall(path.read_text())}
    assert len(named) > 40
    assert {(flag, name) for flag, name in named if flag not in known} == set()


@pytest.mark.parametrize("kind", ROOMS)
def test_a_field_becomes_an_option_only_where_the_command_has_it(kind):
    message, command = import_kind(kind).options, ROOMS[kind].command
    options = OPTIONS[f"{command} {command}"]
    for field in message.model_fields:
        assert (
            set(NAMED.findall(name_options_in_text(message, f"give `{field}` or `{field}: value`")))
            <= options
        ), field


def test_a_missing_word_is_named_with_those_that_are_accepted(tmp_path):
    campaign, program = tmp_path / "campaign.json", tmp_path / "pocket.src"
    assert terminal("simulate", campaign).exit_code == 0
    program.write_text("DEF pocket()\nEND\n")
    shown = terminal("compensate", campaign, program, "-o", tmp_path / "x.src", width=200)
    assert shown.exit_code == 2
    assert "give `--accuracy-option`: one of off, same_as_measured, compensates_load" in shown.stderr
