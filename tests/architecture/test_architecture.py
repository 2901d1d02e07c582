"""The shape of the house and of its tests: rooms, public names, docstrings, one triangle, notices, lanes."""

import ast
import json
import re
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from importlib.metadata import distribution, distributions
from itertools import permutations
from pathlib import Path

import grimp
import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from support.sources import nodes

from jointstiff import solver
from jointstiff.service.process import build_own_command

ROOT = Path(__file__).parents[2]
REFUSED = (
    *("What", "Of", "Whether", "That", "Where", "How", "Why", "Which", "Who", "Whom", "Whose", "Those"),
    *("To", "As", "From", "On", "With", "Without", "Under", "Are", "Is", "Say", "Likewise"),
)
REFUSED_IN_FIELDS = {*REFUSED, "In", "By", "Its", "When", "Along", "They"}


DESCRIBED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def docstrings(folder: str) -> list[str]:
    """The docstrings of a folder's modules, classes and functions, each with its place."""
    return [
        f"{path.relative_to(ROOT)}:{node.body[0].lineno}: {text}"
        for path in sorted((ROOT / folder).rglob("*.py"))
        for node in nodes(path)
        if isinstance(node, DESCRIBED) and (text := ast.get_docstring(node)) is not None
    ]


@pytest.mark.parametrize(
    "folder", ["solver", "service", "schemas", "examples", "benchmarks", "packages/robotprograms/src"]
)
def test_docstrings_begin_with_a_verb_or_a_noun(folder):
    texts = docstrings(folder)
    riddles = [text for text in texts if text.split(": ", 1)[1].split()[0].rstrip(",") in REFUSED]
    assert len(texts) > 20
    assert not riddles, "\n".join(riddles)


PRIVATE_WORDS = (
    "beside",
    "told",
    "stands",
    "said",
    "asked for",
    "who asks",
    "waits for its turn",
    "of which",
)
"""Words with several meanings in this project; CONTRIBUTING has the words to use."""


@pytest.mark.parametrize("folder", ["solver", "service", "schemas", "packages/robotprograms/src"])
def test_private_words_are_gone_from_the_code(folder):
    """Names, comments, docstrings and messages use the words of CONTRIBUTING's table."""
    private = re.compile("|".join(rf"\b{word}\b" for word in PRIVATE_WORDS), re.IGNORECASE)
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in sorted((ROOT / folder).rglob("*.py"))
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if private.search(line)
    ]
    assert not found, "\n".join(found)


def descriptions(node: object, place: str = "") -> Iterator[tuple[str, str]]:
    """Every description in a document, with its place; of operations the sentence that begins it."""
    if isinstance(node, dict):
        if isinstance(text := node.get("summary", node.get("description")), str):
            yield place, text
        for key, value in node.items():
            yield from descriptions(value, f"{place}/{key}")
    elif isinstance(node, list):
        for i, value in enumerate(node):
            yield from descriptions(value, f"{place}/{i}")


def test_descriptions_of_the_api_begin_with_a_noun_or_a_verb(openapi):
    """They are the help of commands and the reference of the API, where they stand beside a bare name."""
    texts = list(descriptions(openapi))
    assert len(texts) > 1200
    first = [(place, text.split()[0].rstrip(",.;:"), text) for place, text in texts]
    assert not [each for each in first if each[1] in REFUSED_IN_FIELDS]


TESTS = Path(__file__).parents[1]
READERS = ROOT / "packages" / "robotprograms"
FILES = sorted([*TESTS.rglob("*.py"), *(READERS / "tests").rglob("*.py")])
STUDIES = TESTS / "studies"
"""Its tests run the studies of benchmarks/; nobody else knows these."""


def imported(path: Path) -> set[str]:
    """Return the first parts of the names of the modules that a file imports."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.split(".")[0])
    return found


def test_tests_import_neither_tests_nor_benchmarks():
    tests = {path.stem for path in FILES if path.stem.startswith(("test_", "conftest"))} | {"tests"}
    for path in FILES:
        refused = tests if STUDIES in path.parents else tests | {"benchmarks"}
        assert not imported(path) & refused, path


PATCHED: dict[str, int] = {}
"""How often private names are still replaced: the numbers may fall and never rise."""


def name_of(called: ast.expr) -> str:
    """Return the last part of what is called: `setattr` of `monkeypatch.setattr`."""
    return called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")


def patches_of_private_names(path: Path) -> int:
    """Count the calls of `monkeypatch.setattr` and `patch` that name something private."""
    calls = [node for node in nodes(path) if isinstance(node, ast.Call)]
    patching = [call for call in calls if name_of(call.func) in ("setattr", "patch", "object")]
    texts = [[a.value for a in call.args[:2] if isinstance(a, ast.Constant)] for call in patching]
    return sum(any(str(text).split(".")[-1].startswith("_") for text in each) for each in texts)


def test_no_further_private_names_are_patched():
    found = Counter({str(path.relative_to(ROOT)): patches_of_private_names(path) for path in FILES})
    assert +found == Counter(PATCHED)


def test_names_of_test_files_are_unique():
    """Two of one name cannot be collected together."""
    names = Counter(path.name for path in FILES if path.name.startswith("test_"))
    assert [name for name, count in names.items() if count > 1] == []


SOLVER = ROOT / "solver"
WHITENED_BY_THEMSELVES = {"fit/method.py", "geometry/poses.py", "geometry/frames.py"}
"""Maps of methods, and positions of geometry, which are no deflections."""


def solver_nodes():
    """Return all nodes of the solver, each with its module."""
    paths = {path.relative_to(SOLVER).as_posix(): path for path in SOLVER.rglob("*.py")}
    return [(name, node) for name, path in paths.items() for node in nodes(path)]


def _compresses(node):
    """Tell whether a node is a QR that keeps the triangle alone; one with pivoting asks for an order."""
    if not isinstance(node, ast.Call) or ast.unparse(node.func).split(".")[-1] != "qr":
        return False
    keywords = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
    return keywords.get("mode") == "'r'" and "pivoting" not in keywords


def test_only_the_triangle_compresses():
    assert {name for name, node in solver_nodes() if _compresses(node)} == {"fit/triangle.py"}


def test_only_readings_whiten_deflections():
    named = {
        name
        for name, node in solver_nodes()
        if isinstance(node, ast.ImportFrom) and any(alias.name == "whitener" for alias in node.names)
    }
    assert named == WHITENED_BY_THEMSELVES


def test_only_terms_know_the_columns_of_a_term():
    users = {
        name
        for name, node in solver_nodes()
        if isinstance(node, ast.Attribute) and node.attr == "motion" and not name.startswith("mechanics/")
        if isinstance(node.value, ast.Name) and node.value.id.isupper()
    }
    assert not users


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    """The imports of all modules. Imports for types alone count: their reader has to read both modules."""
    return grimp.build_graph("jointstiff", exclude_type_checking_imports=False)


def circles(names: list[str], imports: set[tuple[str, str]]) -> list[list[str]]:
    """The groups of names that import each other, directly or by way of others."""
    if not names:
        return []
    matrix = np.array([[(a, b) in imports for b in names] for a in names])
    count, group = connected_components(matrix, connection="strong")
    groups = [[name for name, g in zip(names, group, strict=True) if g == i] for i in range(count)]
    return [each for each in groups if len(each) > 1]


def test_no_modules_import_each_other_in_a_circle(graph):
    modules = sorted(graph.modules)
    imports = {(a, b) for a in modules for b in graph.find_modules_directly_imported_by(a)}
    assert len(modules) > 300
    assert circles(modules, imports) == []


def test_no_rooms_import_each_other_in_a_circle(graph):
    """Of two modules or folders of one folder, one does not know the other: the kinds not the library."""
    found = list[list[str]]()
    for folder in graph.modules:
        rooms = sorted(graph.find_children(folder))
        room_of = {inner: room for room in rooms for inner in (room, *graph.find_descendants(room))}
        imports = {
            (room, room_of[imported])
            for inner, room in room_of.items()
            for imported in graph.find_modules_directly_imported_by(inner)
            if imported in room_of
        }
        found += circles(rooms, imports)
    assert found == []


LAYERED = ("jointstiff", "jointstiff.service", "jointstiff.solver", "jointstiff.solver.fit")
"""Packages whose layers `pyproject.toml` names, the first of them at the top."""


@pytest.mark.parametrize("package", LAYERED)
def test_no_import_goes_up(graph, package):
    """import-linter checks the same, but for imports for types alone."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    contracts = [each for each in settings["contracts"] if each["type"] == "layers"]
    (layers,) = (each["layers"] for each in contracts if each.get("containers", ["jointstiff"]) == [package])
    rank = {
        f"{package}.{name.strip().removeprefix('jointstiff.')}": number
        for number, layer in enumerate(layers)
        for name in re.split("[|:]", layer)
    }
    assert len(rank) > 3
    up = [
        f"{importer} → {imported}"
        for upper, lower in permutations(rank, 2)
        if rank[upper] < rank[lower]
        for importer in (lower, *graph.find_descendants(lower))
        for imported in graph.find_modules_directly_imported_by(importer)
        if imported == upper or imported.startswith(f"{upper}.")
    ]
    assert up == []


PUBLIC_PACKAGES = {ROOT / "solver" / "__init__.py"}
"""Packages from which names are imported; every other module is imported by its name."""


@pytest.mark.parametrize("room", ["solver", "service"])
def test_few_modules_lie_in_a_room(room):
    assert len(list((ROOT / room).glob("*.py"))) <= 8


@pytest.mark.parametrize("room", ["solver", "service", "schemas"])
def test_packages_say_what_they_are_for_and_give_no_names_of_their_modules(room):
    inits = {path: path.read_text(encoding="utf-8") for path in (ROOT / room).rglob("__init__.py")}
    assert inits
    assert not [path for path, text in inits.items() if not text.startswith('"""')]
    assert not [path for path, text in inits.items() if path not in PUBLIC_PACKAGES and "__all__" in text]


def test_the_solver_gives_every_name_that_it_promises():
    given = {name: getattr(solver, name) for name in solver.__all__}
    assert all(value.__name__ == name for name, value in given.items())


NOTICES = (ROOT / "dashboard" / "public" / "notices.txt").read_text(encoding="utf-8")


def test_libraries_of_the_page_are_named_with_their_copyright():
    libraries = json.loads((ROOT / "dashboard" / "package.json").read_text())["dependencies"]
    for name in libraries:
        assert re.search(rf"Copyright .*{re.escape(name)}", NOTICES), name


def test_packages_that_are_not_permissive_are_named():
    names = re.findall(r"^([a-z0-9.-]+)(?:\[.*\])?==", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
    assert len(names) > 40
    for name in set(names) & {
        one.name.lower().replace("_", "-") for one in distributions()
    }:  # of this system
        metadata = distribution(name).metadata
        stated = " ".join([metadata.get("License-Expression", ""), *(metadata.get_all("Classifier") or [])])
        if re.search("GPL|GNU|MPL|Mozilla", stated):
            assert name in NOTICES, name


def test_a_service_reads_all_files_that_its_page_offers():
    """`[service]` and the container have the libraries; a user of the page cannot install them."""
    page = (ROOT / "dashboard/src/features/readings/flow.tsx").read_text("utf-8")
    lock = (ROOT / "requirements.lock").read_text("utf-8")
    for kind, library in {"xlsx": "python-calamine", "mat": "scipy", "h5": "h5py"}.items():
        assert f".{kind}" in page
        assert re.search(rf"^{library}==", lock, re.MULTILINE), f"scripts/lock leaves out {library}"


def test_processes_of_our_modules_do_not_search_the_working_folder():
    assert build_own_command("jointstiff.x", "1") == [sys.executable, "-P", "-m", "jointstiff.x", "1"]
    starting = [path.name for path in (ROOT / "service").rglob("*.py") if '"-m"' in path.read_text("utf-8")]
    assert starting == ["process.py"], "start modules by `build_own_command`"


def test_a_process_of_an_unmarked_test_is_refused():
    with pytest.raises(pytest.fail.Exception, match=r"mark it @pytest\.mark\.process"):
        subprocess.run([sys.executable, "-c", ""], check=True)


@pytest.mark.process
def test_a_process_of_a_marked_test_is_not():
    subprocess.run([sys.executable, "-c", ""], check=True)


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_a_test_on_postgresql_is_marked(request, kind):
    expected = {"sqlite": set(), "postgresql": {"postgresql", "process"}}[kind]
    assert {mark.name for mark in request.node.iter_markers()} - {"parametrize", "xdist_group"} == expected


def test_one_worker_runs_all_tests_of_a_group(request):
    """Pytest 9.2 with xdist 3.8 ran every group in every worker without a word."""
    if not getattr(request.config.option, "loadgroup", False):
        pytest.skip("groups are for workers of xdist: -n 2 --dist loadgroup")
    assert request.node.nodeid.endswith("@test_architecture")


WORDS_FOR_USERS = {"reason", "detail", "remedy", "message"}
SEARCHES = {"startswith", "endswith", "find", "index", "partition", "rpartition", "split", "replace"}
OF_OTHER_LIBRARIES = {"service/api/bodies.py", "service/reports/rendering.py"}


def searched_words(path: Path) -> Iterator[str]:
    """The places of a module that look for words in a sentence for users, to decide by it or to change it."""
    for node in nodes(path):
        sentence: ast.expr | None = None
        if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn):
            is_text = isinstance(node.left, ast.Constant | ast.JoinedStr)
            sentence = node.comparators[0] if is_text else None
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            sentence = node.func.value if node.func.attr in SEARCHES else None
        if isinstance(sentence, ast.Attribute) and sentence.attr in WORDS_FOR_USERS:
            yield f"{path.relative_to(ROOT)}: {ast.unparse(node)}"


def test_no_sentence_of_our_own_is_parsed_back():
    """A restore took each error with the words `does not exist` for a missing database."""
    paths = [path for folder in ("service", "solver", "schemas") for path in (ROOT / folder).rglob("*.py")]
    ours = [path for path in paths if str(path.relative_to(ROOT)) not in OF_OTHER_LIBRARIES]
    assert [place for path in ours for place in searched_words(path)] == []
