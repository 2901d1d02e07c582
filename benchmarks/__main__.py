"""Run the benchmarks: `python -m benchmarks`; see the package's docstring."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import benchmarks

if TYPE_CHECKING:
    from benchmarks.report import Figure, Section

__all__ = ["BENCHMARKS", "Benchmark"]


@dataclass(frozen=True)
class Benchmark:
    """A name of the command line: the module whose `run` it calls, and when it runs."""

    module: str  # below `benchmarks`
    what: str
    always: bool = False  # runs when no benchmark is named
    in_parts: bool = False  # `--part 2/4` runs the second of four parts


BENCHMARKS = {
    # Memory before large, which leaves this process big.
    "small": Benchmark("performance.small", "19 configurations", always=True),
    "resampling": Benchmark("performance.resampling", "1,000 times 10 of 19", always=True),
    "post": Benchmark("performance.post", "a run over HTTP", always=True),
    "in_process": Benchmark("performance.in_process", "a run beside the bare numerical core", always=True),
    "memory": Benchmark("performance.memory", "up to 1,000,000 configurations", always=True),
    "start": Benchmark("performance.start", "commands beside bare imports, idle memory", always=True),
    "large": Benchmark("performance.large", "100,000 configurations", always=True),
    "width": Benchmark("performance.width", "1,000 campaigns on two processes beside one; 10 minutes"),
    "plan": Benchmark("performance.plan", "optimal designs beside cvxpy"),
    "maps": Benchmark("performance.maps", "beside a loop of Pinocchio calls"),
    "corrections": Benchmark(
        "performance.corrections", "arrays of poses beside EAIK; wrong frames, branches"
    ),
    "year": Benchmark(
        "performance.year", "lists, searches and trends of 100,000 runs; 10 minutes", in_parts=True
    ),
    "archive": Benchmark(
        "performance.archive", "10,000 runs and 50,000 sets; restores killed; half an hour", in_parts=True
    ),
    "exactness": Benchmark("studies.exactness", "against exact rational arithmetic", always=True),
    "coverage": Benchmark("studies.coverage", "how often intervals hold the truth; some minutes"),
    "prismatic": Benchmark("studies.prismatic", "a SCARA and an arm on a rail beside exact springs"),
    "causes": Benchmark("studies.causes", "planted, named and mended; clean ones", in_parts=True),
    "load_paths": Benchmark(
        "studies.load_paths", "tool, rope, hook, growth, another stiffness: named; clean ones", in_parts=True
    ),
    "posture_errors": Benchmark("studies.posture_errors", "errors that a posture's targets share: coverage"),
    "repeatability": Benchmark(
        "studies.repeatability", "few postures or one target of joints that do not repeat; some minutes"
    ),
    "statements": Benchmark("studies.statements", "loads within what is stated: accusations, ratios"),
    "levers": Benchmark("studies.levers", "a load near axis 6: coverage, widths beside a dense grid"),
    "pure_error": Benchmark("studies.pure_error", "noise whatever the model: clean ones, mistakes"),
    "grounds": Benchmark("studies.grounds", "load points stated with and without a ground; 10 minutes"),
    "force_grounds": Benchmark("studies.force_grounds", "forces by cell, pulley and catalogue; 15 minutes"),
    "base": Benchmark("studies.base", "pedestals that bend, and clean arms; an hour", in_parts=True),
    "live": Benchmark("studies.live", "readings until a goal is met; mistakes at the reading", in_parts=True),
    "live_service": Benchmark(
        "attacks.live_service", "kill -9 while readings are sent; fifty campaigns at once", in_parts=True
    ),
    "encoder_logs": Benchmark(
        "studies.encoder_logs", "gearboxes from a controller's logs: 80 arms; 15 minutes", in_parts=True
    ),
    "weight_steps": Benchmark(
        "studies.weight_steps", "gearboxes from two encoders: 600 steps, mistakes; 5 minutes", in_parts=True
    ),
    "gearbox_pairs": Benchmark(
        "studies.gearbox_pairs",
        "gearbox and structure by one fit of motor and secondary runs; 15 minutes",
        in_parts=True,
    ),
    "encoders": Benchmark(
        "studies.encoders", "tracker and encoders, with play in the gears; 5 minutes", in_parts=True
    ),
    "beams": Benchmark(
        "studies.beams", "elastic links, load point off; draws of noise; 10 minutes", in_parts=True
    ),
    "witness": Benchmark("studies.witness", "an honest solver and lying ones; 10 minutes", in_parts=True),
    "crossings": Benchmark("studies.crossings", "modules and packages that a run goes through"),
    "links_fanuc": Benchmark("studies.links_fanuc", "elastic links, held out on the real set", in_parts=True),
    "own_weight": Benchmark(
        "studies.own_weight", "stiffness without a load; docs/without-a-load.md", in_parts=True
    ),
    "meanings": Benchmark(
        "studies.meanings", "columns of 30 layouts by the robot, wrong tables; half an hour", in_parts=True
    ),
    "mistakes": Benchmark(
        "studies.mistakes", "29 mistakes of campaigns in arrays, frames and files; 20 minutes", in_parts=True
    ),
    "programs": Benchmark("studies.programs", "on exact springs, beside a loop of EAIK; docs/correct.md"),
    "shares": Benchmark("studies.shares", "moves known in programs as people write them; docs/correct.md"),
    "mutants": Benchmark("studies.mutants", "small changes of all houses; half an hour", in_parts=True),
    "attacks": Benchmark(
        "attacks.attacks", "hostile bodies, connections, many posts; a quarter of an hour", in_parts=True
    ),
    "connections": Benchmark(
        "attacks.slow_connections", "silent and slow connections to a service without a proxy; four minutes"
    ),
    "hostile": Benchmark(
        "attacks.hostile_requests",
        "100,000 hostile requests; a quarter of an hour",
        in_parts=True,
    ),
    "growth": Benchmark("attacks.growth", "time of the program readers on hostile lines", in_parts=True),
    "faults": Benchmark(
        "attacks.faults", "disks, locks, clocks, servers, workers; 10 minutes, as root", in_parts=True
    ),
    "durability": Benchmark(
        "attacks.durability", "kill -9 of workers and services; half an hour", in_parts=True
    ),
    "versions": Benchmark(
        "attacks.versions", "two versions on one database, with posts; 20 minutes", in_parts=True
    ),
    "lost_writes": Benchmark(
        "attacks.lost_writes",
        "writes of PostgreSQL that are cut at random bytes; an hour",
        in_parts=True,
    ),
    "stuck": Benchmark(
        "attacks.stuck",
        "six kinds of jobs that do not move, as root; 20 minutes",
        in_parts=True,
    ),
    "queue": Benchmark(
        "attacks.queue", "stopped processes, many runs, large jobs beside small ones", in_parts=True
    ),
}
PACKAGES = ("jointstiff", "numpy", "scipy", "pin", "cvxpy-base", "clarabel", "qpsolvers", "proxsuite")
_WIDTH = 130  # where the output is no terminal
_DATA = Path(__file__).parents[2] / "shared" / "data"


def main() -> None:
    """Run what is asked for and print what was found."""
    arguments = _arguments()
    try:
        from rich.console import Console

        from benchmarks import record
        from benchmarks.report import print_figures, print_section

        machine, functions = _machine(), _functions(arguments)
    except ModuleNotFoundError as error:
        sys.exit(
            f"{error}. The benchmarks need the development set-up: "
            "run scripts/setup requirements-dev.lock, then .venv/bin/python -m benchmarks"
        )
    if arguments.record:
        record.refuse_changes()
    console = Console() if sys.stdout.isatty() else Console(width=_WIDTH)
    console.print(f"{machine['processors']} processors, load {machine['load']:.2f}; {machine['versions']}\n")
    measured: list[Section] = []
    for name, function in functions.items():
        sections: list[Section] = []
        with Console(stderr=True).status(f"{name} …"):
            for section in _measure(name, function):
                print_section(console, section)
                sections.append(section)
        if arguments.record:
            record.write({name: _figures(sections)})
        measured += sections
    print_figures(console, _figures(measured), judged=not arguments.quick)
    if arguments.json is not None:
        document = {"quick": arguments.quick, "machine": machine, "sections": list(map(_plain, measured))}
        arguments.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _functions(arguments: argparse.Namespace) -> dict[str, Callable[[], Iterable[Section]]]:
    from benchmarks.report import Part

    functions: dict[str, Callable[[], Iterable[Section]]] = {}
    for name in arguments.benchmarks:
        benchmark = BENCHMARKS[name]
        run = importlib.import_module(f"benchmarks.{benchmark.module}").run
        options: dict[str, Any] = {"part": Part(*arguments.part)} if benchmark.in_parts else {}
        functions[name] = partial(run, quick=arguments.quick, **options)
    return functions


def _measure(name: str, function: Callable[[], Iterable[Section]]) -> Iterator[Section]:
    """Yield the sections of a benchmark, each as soon as it is measured."""
    from benchmarks.report import Section

    try:
        yield from function()
    except FileNotFoundError as missing:
        if not str(missing.filename).startswith(str(_DATA)):
            raise
        note = "skipped, as the recorded data are not beside this checkout (../shared/data)"
        yield Section(name, (note,), ())


def _figures(sections: list[Section]) -> list[Figure]:
    return [figure for section in sections for figure in section.figures]


def _arguments() -> argparse.Namespace:
    in_parts = ", ".join(name for name, each in BENCHMARKS.items() if each.in_parts)
    lines = (f"  {name:<16}{'* ' if each.always else '  '}{each.what}" for name, each in BENCHMARKS.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=benchmarks.__doc__,
        epilog="\n".join(("benchmarks (* runs when none is named):", *lines)),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("benchmarks", nargs="*", metavar="BENCHMARK", help="names from the list below")
    parser.add_argument("--all", action="store_true", help="run all benchmarks")
    parser.add_argument("--quick", action="store_true", help="tiny sizes: a smoke test, nothing is judged")
    parser.add_argument(
        "--part", type=_part, default=(1, 1), metavar="K/N", help=f"the K-th of N parts of {in_parts}"
    )
    parser.add_argument(
        "--record", action="store_true", help="run all, or those named, and write docs/figures.md"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there, too")
    arguments = parser.parse_args()
    if unknown := set(arguments.benchmarks) - set(BENCHMARKS):
        parser.error(f"no benchmark {', '.join(sorted(unknown))}; there are {', '.join(BENCHMARKS)}")
    if arguments.record and arguments.quick:
        parser.error("--quick measures nothing to record")
    if not arguments.benchmarks and (arguments.all or arguments.record):
        arguments.benchmarks = list(BENCHMARKS)
    arguments.benchmarks = arguments.benchmarks or [name for name, each in BENCHMARKS.items() if each.always]
    return arguments


def _part(text: str) -> tuple[int, int]:
    number, _, count = text.partition("/")
    return int(number), int(count)


def _machine() -> dict[str, Any]:
    return {
        "processors": os.cpu_count(),
        "load": os.getloadavg()[0],
        "platform": platform.platform(),
        "versions": ", ".join(f"{name} {version(name)}" for name in PACKAGES),
    }


def _plain(section: Section) -> dict[str, Any]:
    figures = [asdict(figure) | {"met": figure.met} for figure in section.figures]
    return asdict(section) | {"figures": figures}


if __name__ == "__main__":
    main()
