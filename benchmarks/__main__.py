"""Run the benchmarks: `python -m benchmarks`; see the package's docstring."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import benchmarks

if TYPE_CHECKING:
    from benchmarks.report import Section

__all__ = ["BENCHMARKS", "Benchmark"]


@dataclass(frozen=True)
class Benchmark:
    """A name of the command line: its function, and when it runs."""

    module: str  # below `benchmarks`
    what: str
    function: str = "run"
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
    "plan": Benchmark("performance.plan", "optimal designs beside cvxpy"),
    "plan_figaroh": Benchmark("performance.plan", "optimal designs beside FIGAROH", "run_figaroh_section"),
    "plan_sizes": Benchmark("performance.plan_sizes", "1e5 and 1e6 candidates"),
    "maps": Benchmark("performance.maps", "beside a loop of Pinocchio calls"),
    "access": Benchmark("performance.access", "the cost of a key; half a minute"),
    "workers": Benchmark("performance.workers", "two beside one, answers meanwhile, cancelling; 4 minutes"),
    "exactness": Benchmark("studies.exactness", "against exact rational arithmetic", always=True),
    "coverage": Benchmark("studies.coverage", "how often intervals hold the truth; some minutes"),
    "prismatic": Benchmark("studies.prismatic", "a SCARA and an arm on a rail beside exact springs"),
    "efficiency": Benchmark("studies.efficiency", "beside the Cramér-Rao bound"),
    "robustness": Benchmark("studies.robustness", "gross errors"),
    "budget": Benchmark("studies.budget", "uncertainty budgets beside Monte Carlo; 5 minutes"),
    "deflection": Benchmark("studies.deflection", "predicted deflections beside exact equilibria"),
    "fanuc": Benchmark("studies.fanuc", "ten of thirty real configurations"),
    "replication": Benchmark("studies.replication", "the paper's study; docs/replication.md"),
    "invariance": Benchmark("studies.invariance", "docs/replication.md"),
    "assessment": Benchmark("studies.assessment", "verdicts on planted mistakes and clean sets; 10 minutes"),
    "causes": Benchmark("studies.causes", "planted, named and mended; clean ones", in_parts=True),
    "default_clean": Benchmark(
        "studies.defaults", "runs without options: clean campaigns", "run_clean", in_parts=True
    ),
    "default_beams": Benchmark(
        "studies.defaults", "runs without options: flexible links", "run_beams", in_parts=True
    ),
    "default_mended": Benchmark(
        "studies.defaults", "planted mistakes and their actions", "run_mended", in_parts=True
    ),
    "default_fanuc": Benchmark("studies.defaults", "the real set without options", "run_fanuc"),
    "mutants": Benchmark("studies.mutants", "small changes of the numerical core; an hour", in_parts=True),
    "integrity": Benchmark("studies.integrity", "mistakes found and named"),
    "importing": Benchmark("studies.importing", "files of readings, as written and mutated; docs/import.md"),
    "links": Benchmark("studies.links", "elastic links; docs/elastic-links.md; some minutes"),
    "links_fanuc": Benchmark("studies.links", "held out on the real set", "run_fanuc", in_parts=True),
    "links_coverage": Benchmark(
        "studies.elastic_campaigns", "intervals on clean beams", "run_coverage", in_parts=True
    ),
    "links_ball": Benchmark(
        "studies.elastic_campaigns", "balls of the model error on beams", "run_ball", in_parts=True
    ),
    "links_answered": Benchmark(
        "studies.elastic_campaigns", "clean beams are answered", "run_answered", in_parts=True
    ),
    "plan_lists": Benchmark("performance.plan_sizes", "efficiency of lists; docs/plan.md", "run_lists"),
    "plan_promise": Benchmark("studies.plan_promise", "plans carried out; docs/plan.md"),
    "plan_nuisance": Benchmark(
        "studies.plan_promise", "elastic links as nuisance; docs/plan.md", "run_nuisance"
    ),
    "programs": Benchmark("studies.programs", "on exact springs, beside a loop of EAIK; docs/compensate.md"),
    "exports": Benchmark("studies.exports", "a run in MuJoCo beside C·τ; docs/exports.md"),
    "reports": Benchmark("studies.reports", "size, time and bytes; docs/report.md"),
    "geometry": Benchmark("studies.geometry", "coverage of sweeps; docs/geometry.md"),
    "geometry_worn": Benchmark("studies.geometry_real", "gears and sag", "run_worn", in_parts=True),
    "geometry_ur5": Benchmark("studies.geometry_real", "poses of a real UR5", "run_ur5"),
    "one_geometry": Benchmark("studies.one_geometry", "sweeps without circles; a minute"),
    "own_weight": Benchmark(
        "studies.own_weight", "stiffness without a load; docs/without-a-load.md", in_parts=True
    ),
    "base": Benchmark("studies.base", "pedestals that bend, and clean arms; an hour", in_parts=True),
    "trend": Benchmark("studies.trend", "false alarms and drifts; docs/trend.md"),
    "scale": Benchmark("studies.scale", "costs of work, parts for many robots; docs/scale.md; some minutes"),
    "attacks": Benchmark(
        "attacks.attacks", "hostile bodies, connections, many posts; a quarter of an hour", in_parts=True
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
        "attacks.durability", "kill -9 of workers and services; 20 minutes", in_parts=True
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

        from benchmarks.report import Part, print_figures, print_section

        machine = _machine()
        functions = {}
        for name in arguments.benchmarks:
            benchmark = BENCHMARKS[name]
            function = getattr(importlib.import_module(f"benchmarks.{benchmark.module}"), benchmark.function)
            part = {"part": Part(*arguments.part)} if benchmark.in_parts else {}
            functions[name] = partial(function, quick=arguments.quick, **part)
    except ModuleNotFoundError as error:
        sys.exit(
            f"{error}. The benchmarks need the development set-up: "
            "run scripts/setup requirements-dev.lock, then .venv/bin/python -m benchmarks"
        )
    console = Console() if sys.stdout.isatty() else Console(width=_WIDTH)
    console.print(f"{machine['processors']} processors, load {machine['load']:.2f}; {machine['versions']}\n")
    sections: list[Section] = []
    for name, function in functions.items():
        try:
            with Console(stderr=True).status(f"{name} …"):
                measured = function()
        except FileNotFoundError as missing:
            if not str(missing.filename).startswith(str(_DATA)):
                raise
            console.print(
                f"{name}: skipped, as the recorded data are not beside this checkout (../shared/data)\n"
            )
            continue
        for section in measured:
            print_section(console, section)
        sections += measured
    figures = [figure for section in sections for figure in section.figures]
    print_figures(console, figures, judged=not arguments.quick)
    if arguments.json is not None:
        document = {"quick": arguments.quick, "machine": machine, "sections": [_plain(s) for s in sections]}
        arguments.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


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
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there, too")
    arguments = parser.parse_args()
    if unknown := set(arguments.benchmarks) - set(BENCHMARKS):
        parser.error(f"no benchmark {', '.join(sorted(unknown))}; there are {', '.join(BENCHMARKS)}")
    if arguments.all:
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
