"""Texts that advise an option name one that a command has."""

import ast
import json
import re
from pathlib import Path

import pytest
from support.terminal import terminal
from typer.main import get_command

import jointstiff
from jointstiff.schemas.correction import CorrectionOptions
from jointstiff.schemas.options import RunOptions
from jointstiff.service.cli.app import app
from jointstiff.service.cli.fields import field_options, name_options_in_text
from jointstiff.service.kinds.rooms import ROOMS, import_kind
from jointstiff.service.problems import find_similar_name
from jointstiff.simulator import default_arm, simulate_campaign

PACKAGE = Path(jointstiff.__file__).parent
OF_OTHERS = {"--publish", "--file", "--format", "--data-binary"}
"""Options of Docker, pg_restore and curl that our texts name."""
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
    shown = terminal("correct", campaign, program, "-o", tmp_path / "x.src", width=200)
    assert shown.exit_code == 2
    assert "give `--accuracy-option`: one of off, same_as_measured\n" in shown.stderr


def texts():
    """Return every text of the sources but docstrings, with X in the place of what is filled in."""
    found = set()
    for path in sources():
        tree = ast.parse(path.read_text())
        documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
        docstrings = {
            id(node.body[0].value)
            for node in ast.walk(tree)
            if isinstance(node, documented) and isinstance(node.body[0], ast.Expr)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                parts = [part.value if isinstance(part, ast.Constant) else "X" for part in node.values]
                found.add("".join(map(str, parts)))
            elif (
                isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings
            ):
                found.add(node.value)
    return sorted(found)


def test_no_text_names_a_field_where_the_command_has_an_option():
    """Whatever the field's value: words, lists, and what is filled in."""
    every, count = texts(), 0
    for kind in ROOMS:
        message = import_kind(kind).options
        fields = "|".join(name for name, _ in field_options(message))
        named = re.compile(rf"`(?:open\.)?({fields})(?:`|: )")
        with_fields = [text for text in every if named.search(text)]
        left = [text for text in with_fields if named.search(name_options_in_text(message, text))]
        assert left == [], kind
        count += len(with_fields)
    assert count > 40


VALUES = {
    "give `load_point`": "give `--load-point`",
    "state `leave_others: true`": "state `--leave-others`",
    "state `leave_others: false`": "state `--no-leave-others`",
    "state `external_axes: carry_nothing`": "state `--external-axes carry_nothing`",
    "name it in `leave_alone`: ['GRIP', 'OPEN_1']": "name it in `--leave-alone GRIP,OPEN_1`",
    "name it in `leave_alone: ['GRIP']`": "name it in `--leave-alone GRIP`",
    "give `accept_verdict: do_not_use`": "give `--despite-verdict`",
    "give `units.length` or `nothing: ['A']`": "give `units.length` or `nothing: ['A']`",
}


@pytest.mark.parametrize("text", VALUES)
def test_a_field_with_its_value_becomes_an_option_with_its_value(text):
    assert name_options_in_text(CorrectionOptions, text) == VALUES[text]


def test_an_option_that_may_be_repeated_is_repeated_for_each_value():
    assert name_options_in_text(RunOptions, "fit `causes: [play, shift]`") == (
        "fit `--cause play --cause shift`"
    )


OF_PYTHON = re.compile(
    r"\bjs\.\w+|jointstiff\.[a-zA-Z]\w*[(`]|`\w+\(|`\w+\.\w+\(|\bdata frame\b|to_parquet|\b[a-z_]+='"
)
FOR_PYTHON = (
    "service/library/",
    "service/conversion/arrays.py",
    "service/conversion/dh_tables.py",
    "service/kinds/verb.py",
)
"""What only arguments of Python reach: objects, arrays and rows of Denavit and Hartenberg."""


def test_no_text_that_reaches_the_terminal_has_words_of_python():
    found = []
    for path in (
        each for room in ("schemas", "solver", "service") for each in (PACKAGE / room).rglob("*.py")
    ):
        place = path.relative_to(PACKAGE).as_posix()
        if not place.startswith(FOR_PYTHON):
            tree = ast.parse(path.read_text())
            docs = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
            texts = (
                each for each in ast.walk(tree) if isinstance(each, ast.Constant) and id(each) not in docs
            )
            found += [
                (place, text.value)
                for text in texts
                if isinstance(text.value, str) and OF_PYTHON.search(text.value)
            ]
    assert found == []


TIPS = """<robot name="a"><link name="b"/><link name="l"/><link name="t1"/><link name="t2"/>
<joint name="j" type="revolute"><parent link="b"/><child link="l"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="f1" type="fixed"><parent link="l"/><child link="t1"/></joint>
<joint name="f2" type="fixed"><parent link="l"/><child link="t2"/></joint></robot>"""


def test_each_door_names_the_remedy_of_a_file_in_its_own_words(tmp_path):
    """Carried out, the remedy of the terminal works there."""
    campaign = simulate_campaign(default_arm(), load="pull", configurations=6, seed=1)
    (tmp_path / "set.json").write_text(json.dumps(campaign["measurement_set"]))
    (tmp_path / "robot.json").write_text(json.dumps(campaign["robot"]))
    (tmp_path / "tips.urdf").write_text(TIPS)
    shown = " ".join(terminal("identify", tmp_path / "set.json", width=300).output.split())
    assert shown.endswith("or use `jointstiff import FILE --robot ROBOT`")
    with pytest.raises(jointstiff.CampaignError, match=r"or use `jointstiff.read\(FILE, robot=ROBOT\)`$"):
        jointstiff.identify(tmp_path / "set.json")

    shown = " ".join(terminal("plan", tmp_path / "tips.urdf", width=300).output.split())
    assert "name the link of the flange behind the name of the file: FILE.urdf#" in shown
    with pytest.raises(jointstiff.CampaignError, match=r"jointstiff.robot\(urdf, flange='\w+'\)$"):
        jointstiff.robot(tmp_path / "tips.urdf")

    planned = ("plan", tmp_path / "robot.json", "--target", "P1=0,0,0.1", "--load", "dead_weight:1500")
    assert terminal(*planned, "--save", tmp_path / "plan.json").exit_code == 0
    shown = " ".join(terminal("rehearse", tmp_path / "plan.json", width=300).output.split())
    assert shown == "robot: the plan has no robot remedy: give `--robot`"
    assert terminal("rehearse", tmp_path / "plan.json", "--robot", tmp_path / "robot.json").exit_code == 0


POCKET = """DEF pocket()
$BASE=BASE_DATA[1]
$TOOL=TOOL_DATA[1]
PTP {X 303,Y 190,Z 505,A 18.5,B 140.5,C 9,S 2,T 2}
LIN {X 303,Y 220,Z 505,A 18.5,B 140.5,C 9}
GRIPPER()
LIN {X 333,Y 220,Z 505,A 18.5,B 140.5,C 9}
LIN_REL {X 10}
END
"""


@pytest.fixture
def correct(tmp_path):
    """Function that runs `correct` for a program with moves that are left; returns result and words."""
    campaign, program = tmp_path / "campaign.json", tmp_path / "pocket.src"
    assert terminal("simulate", campaign).exit_code == 0
    program.write_text(POCKET)

    def run(*options):
        line = ["correct", campaign, program, "--force", "0,0,-1000", "--accuracy-option", "off", *options]
        shown = terminal(*line, width=300)
        return shown, " ".join(shown.output.split())

    return run


def test_refused_moves_are_counted_and_the_options_that_help_are_named(correct, tmp_path):
    """Each option that the message names is then accepted."""
    output = ("--output", tmp_path / "out.src")
    shown, words = correct(*output)
    assert shown.exit_code == 2
    assert words.startswith("Moves cannot be corrected 'pocket.src', line 6: 'GRIPPER' is unknown")
    assert "state `--trust-routines`, or name the routine in `--leave-alone GRIPPER`" in words
    assert words.endswith(
        "remedy: write 2 of 4 moves anew; or state `--leave-others` to correct only the other 2"
    )
    shown, words = correct(*output, "--leave-alone", "GRIPPER")
    assert words.endswith("write 1 of 4 moves anew; or state `--leave-others` to correct only the other 3")
    shown, words = correct(*output, "--leave-alone", "GRIPPER", "--leave-others")
    assert words == (
        "tools: the program uses the frame 'TOOL_DATA[1]', but does not define its numbers "
        "remedy: give the name 'TOOL_DATA[1]' and the numbers in `--tools`"
    )
    frames = ("--tools", "TOOL_DATA[1]=0,0,200,0,0,0", "--bases", "BASE_DATA[1]=1500,100,1000,0,0,0")
    shown, words = correct(*output, "--leave-others", *frames, "--details")
    assert shown.exit_code == 0, words
    assert "2 of 4 moves were corrected, 2 were left unchanged" in words
    assert "name the routine in `--leave-alone GRIPPER`" in words


def test_an_explanation_names_options_too(correct):
    shown, words = correct("--explain")
    assert shown.exit_code == 0
    assert "state `--trust-routines`, or name the routine in `--leave-alone GRIPPER` line 8" in words


UNKNOWN = {
    ("identify", "--fix"): "No such option: --fix. `jointstiff identify --help` lists the options",
    ("measure", "--fix"): "No such option: --fix. `jointstiff measure --help` lists the options",
    ("geometry", "--fix"): "No such option: --fix. `jointstiff geometry --help` lists the options",
    ("identify", "--lambda"): "No such option: --lambda. `jointstiff identify --help` lists the options",
    ("simulate", "--model"): "No such option: --model. `jointstiff simulate --help` lists the options",
    ("correct", "--tol"): "No such option: --tol. `jointstiff correct --help` lists the options",
    ("measure", "--points"): "No such option: --points. `jointstiff measure --help` lists the options",
    ("identify", "--priors"): "No such option: --priors (Possible options: --prior)",
    ("correct", "--port"): "No such option: --port. --port is an option of `jointstiff serve`",
}


@pytest.mark.parametrize("words", UNKNOWN, ids=" ".join)
def test_an_unknown_option_is_answered_with_a_similar_option_or_with_the_list(words):
    refused = terminal(*words, width=300)
    shown = " ".join(refused.output.split())
    assert (refused.exit_code, UNKNOWN[words] in shown) == (2, True), shown


@pytest.mark.parametrize(
    ("word", "known", "meant"),
    [
        ("radians", ["readings"], None),
        ("weights", ["weight_step"], None),
        ("tol", ["tool"], None),
        ("ridge", ["bridge"], None),
        ("port", ["report"], None),
        ("host", ["most"], None),
        ("kidn", ["kind"], "kind"),
        ("methode", ["method"], "method"),
        ("leave-outs", ["leave_out"], "leave_out"),
    ],
)
def test_a_name_with_a_few_letters_in_common_is_not_suggested(word, known, meant):
    assert find_similar_name(word, known) == meant
