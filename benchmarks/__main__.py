"""Run the benchmarks: `python -m benchmarks`; see the package's docstring."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console

import benchmarks
from benchmarks import (
    access,
    assessment,
    attacks,
    budget,
    coverage,
    deflection,
    durability,
    efficiency,
    elastic_campaigns,
    exactness,
    exports,
    fanuc,
    faults,
    geometry,
    geometry_real,
    hostile_requests,
    importing,
    in_process,
    integrity,
    invariance,
    large,
    links,
    maps,
    memory,
    plan,
    plan_promise,
    plan_sizes,
    post,
    programs,
    replication,
    reports,
    resampling,
    robustness,
    small,
    start,
    trend,
    workers,
)
from benchmarks.report import Part, Section, print_figures, print_section

RUNNERS: dict[str, Callable[..., list[Section]]] = {
    # Memory before large, which leaves this process big.
    "small": small.run,
    "resampling": resampling.run,
    "post": post.run,
    "in_process": in_process.run,
    "memory": memory.run,
    "start": start.run,
    "large": large.run,
    "plan": plan.run,
    "plan_figaroh": plan.run_figaroh_section,
    "plan_sizes": plan_sizes.run,
    "plan_lists": plan_sizes.run_lists,
    "plan_promise": plan_promise.run,
    "plan_nuisance": plan_promise.run_nuisance,
    "exactness": exactness.run,
    "workers": workers.run,
    "durability": durability.run,
    "access": access.run,
    "attacks": attacks.run,
    "hostile": hostile_requests.run,
    "faults": faults.run,
    "coverage": coverage.run,
    "deflection": deflection.run,
    "maps": maps.run,
    "programs": programs.run,
    "exports": exports.run,
    "reports": reports.run,
    "efficiency": efficiency.run,
    "robustness": robustness.run,
    "fanuc": fanuc.run,
    "budget": budget.run,
    "replication": replication.run,
    "invariance": invariance.run,
    "geometry": geometry.run,
    "geometry_worn": geometry_real.run_worn,
    "geometry_ur5": geometry_real.run_ur5,
    "integrity": integrity.run,
    "importing": importing.run,
    "assessment": assessment.run,
    "links": links.run,
    "links_fanuc": links.run_fanuc,
    "links_coverage": elastic_campaigns.run_coverage,
    "links_answered": elastic_campaigns.run_answered,
    "trend": trend.run,
}
IN_PARTS = frozenset({"hostile", "geometry_worn", "links_fanuc", "links_coverage", "links_answered"})
"""They take some minutes, and `--part 2/4` runs the second of four parts."""
STUDIES = frozenset(
    {
        "coverage",
        "deflection",
        "programs",
        "exports",
        "reports",
        "efficiency",
        "robustness",
        "fanuc",
        "replication",
        "invariance",
        "links",
        *IN_PARTS,
        "assessment",
        "integrity",
        "importing",
        "geometry",
        "geometry_ur5",
        "plan_lists",
        "plan_promise",
        "plan_nuisance",
        "trend",
    }
)
"""They prove numbers and compare no times."""
BY_NAME = (
    frozenset({"access", "attacks", "faults", "maps", "workers", "durability"})
    | frozenset({"plan", "plan_figaroh", "plan_sizes"})
    | STUDIES
)
"""They run only when they are asked for; most take long."""
PACKAGES = ("jointstiff", "numpy", "scipy", "pin", "cvxpy-base", "clarabel", "qpsolvers", "proxsuite")
_WIDTH = 130  # where the output is no terminal


def main() -> None:
    """Run what is asked for and print what was found."""
    arguments = _arguments()
    console = Console() if sys.stdout.isatty() else Console(width=_WIDTH)
    machine = _machine()
    console.print(f"{machine['processors']} processors, load {machine['load']:.2f}; {machine['versions']}\n")
    sections = []
    for name in arguments.benchmarks:
        with Console(stderr=True).status(f"{name} …"):
            part = {"part": arguments.part} if name in IN_PARTS else {}
            found = RUNNERS[name](quick=arguments.quick, **part)
        for section in found:
            print_section(console, section)
        sections += found
    figures = [figure for section in sections for figure in section.figures]
    print_figures(console, figures, judged=not arguments.quick)
    if arguments.json is not None:
        document = {"quick": arguments.quick, "machine": machine, "sections": [_plain(s) for s in sections]}
        arguments.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=benchmarks.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "benchmarks",
        nargs="*",
        metavar="BENCHMARK",
        help=f"{', '.join(RUNNERS)}; all but {', '.join(sorted(BY_NAME))} if none",
    )
    parser.add_argument("--quick", action="store_true", help="tiny sizes: a smoke test, nothing is judged")
    parser.add_argument(
        "--part",
        type=_part,
        default=Part(),
        metavar="K/N",
        help=f"the K-th of N parts of {', '.join(sorted(IN_PARTS))}",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there, too")
    arguments = parser.parse_args()
    if unknown := set(arguments.benchmarks) - set(RUNNERS):
        parser.error(f"no benchmark {', '.join(sorted(unknown))}; there are {', '.join(RUNNERS)}")
    arguments.benchmarks = arguments.benchmarks or [name for name in RUNNERS if name not in BY_NAME]
    return arguments


def _part(text: str) -> Part:
    number, _, count = text.partition("/")
    return Part(int(number), int(count))


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
