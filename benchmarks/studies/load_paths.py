"""Terms of the load's path and of the arm: planted, named and mended; clean campaigns are silent.

Readings come from springs that balance the load exactly; what is planted is done to loads, springs and places
of that simulator, never by the solver's own terms.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from benchmarks.designs import Design
from benchmarks.report import Figure, Part, Section
from benchmarks.studies.causes import Outcome, identify_with_causes
from benchmarks.studies.planted import POINTS, STREAM, Planted, design_campaign, place_targets, read
from jointstiff.simulator.equilibrium import equilibrium

__all__ = ["run"]

_SIZES: Final = (0.5, 0.75, 1.0)
_SCATTER: Final = 2e-5
"""Standard deviation of each joint's angle from reading to reading [rad]."""
Generator = np.random.Generator


def _hang_three_sizes(design: Design, generator: Generator) -> Design:
    """Return the campaign with loads of three sizes."""
    sizes = generator.choice(_SIZES, (len(design.loaded), 1))
    return Design.by(design.arm, replace(design.experiment, forces=sizes * design.experiment.forces))


def _scatter_joints(planted: Planted, generator: Generator) -> Planted:
    """Turn the joints by chance between the readings without and with load."""
    angles = planted.true.experiment.joints
    turns = np.sqrt(2.0) * _SCATTER * generator.standard_normal(angles.shape)
    return planted.move(place_targets(planted.true, angles + turns) - place_targets(planted.true, angles))


def _offset_rope_cell(planted: Planted, generator: Generator) -> Planted:
    zero = generator.uniform(50.0, 70.0) * generator.choice([-1.0, 1.0])
    forces = planted.stated.experiment.forces
    along = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    return planted.restate(forces=forces + zero * along)


def _bend_tool(planted: Planted, generator: Generator) -> Planted:  # noqa: ARG001
    """Bend a tool of 2e7 N/m and 1e6 N·m/rad between flange and targets."""
    experiment = planted.true.experiment
    posture = planted.true.arm.posture(experiment.joints)
    forces, moments, _ = (np.asarray(each) for each in experiment.wrenches)
    in_base = posture.flange_rotation
    to_load = np.einsum("nij,nj->ni", in_base, experiment.load_points)
    moment = moments + np.cross(to_load, forces)
    levers = np.einsum("nij,tj->nti", in_base, POINTS)
    return planted.move(forces[:, None] / 2e7 + np.cross(moment[:, None] / 1e6, levers))


def _grow(planted: Planted, generator: Generator) -> Planted:  # noqa: ARG001
    return planted.move(6e-5 * planted.true.loaded)


def _grow_over_time(planted: Planted, generator: Generator) -> Planted:  # noqa: ARG001
    places = planted.true.loaded
    progress = np.arange(len(places)) / len(places)
    return planted.move(1.2e-4 * progress[:, None, None] * places)


def _soften_joints(planted: Planted, generator: Generator) -> Planted:
    """Soften or stiffen three joints by 1.25 to 2 from one observation in the middle on."""
    arm, experiment = planted.true.arm, planted.true.experiment
    count = len(planted.loaded)
    first = int(generator.integers(count // 3, 2 * count // 3))
    factors = np.ones(6)
    factors[generator.choice(6, 3, replace=False)] = generator.uniform(1.25, 2.0, 3)
    changed = replace(arm, stiffnesses=arm.stiffnesses * factors)
    bent = equilibrium(changed, experiment.joints, *experiment.wrenches)
    motion = place_targets(planted.true, experiment.joints + bent) - planted.true.loaded
    motion[:first] = 0.0
    return planted.move(motion)


def _hang_hook(planted: Planted, generator: Generator) -> Planted:
    """Hang a hook of 3 kg with every load, which nobody weighed."""
    weight = generator.uniform(25.0, 35.0)
    return planted.restate(forces=planted.stated.experiment.forces + weight * np.array([0.0, 0.0, 1.0]))


@dataclass(frozen=True)
class _Case:
    """Planted error, and the number of campaigns of fifteen that must name it."""

    plant: Callable[[Planted, Generator], Planted]
    least: int
    sizes: bool = False


CASES: Final[dict[str, _Case]] = {
    "tool": _Case(_bend_tool, 13),
    "growth": _Case(_grow, 13),
    "growth_over_time": _Case(_grow_over_time, 13),
    "stiffness": _Case(_soften_joints, 13),
    "hook_weight": _Case(_hang_hook, 13),
    "rope_zero": _Case(_offset_rope_cell, 6, sizes=True),
}


def study_planted(name: str, seed: int) -> Outcome:
    """Plant a cause in a campaign, and identify it."""
    case, generator = CASES[name], np.random.default_rng([seed, STREAM, 5])
    design = design_campaign(5000 + seed)
    if case.sizes:
        design = _hang_three_sizes(design, generator)
    measured = read(case.plant(Planted.clean(design), generator), generator, sigma=True)
    return identify_with_causes(design.arm, measured)


def study_clean(seed: int) -> Outcome:
    """Read a clean arm: half of the campaigns with loads of three sizes, half with a scatter of 20 µrad."""
    generator = np.random.default_rng([seed, STREAM, 6])
    design = design_campaign(7000 + seed)
    if seed % 2:
        design = _hang_three_sizes(design, generator)
    planted = Planted.clean(design)
    if seed // 2 % 2:
        planted = _scatter_joints(planted, generator)
    return identify_with_causes(design.arm, read(planted, generator, sigma=True))


def run(*, quick: bool, part: Part) -> list[Section]:
    """Plant each cause, name it and fit it together with the joints; then read clean arms."""
    seeds, clean = part.of(3 if quick else 15), part.of(8 if quick else 240)
    rows, figures = [], []
    for name, case in CASES.items():
        outcomes = [study_planted(name, seed) for seed in seeds]
        named = sum(name in each.named for each in outcomes)
        others = Counter(", ".join(each.named) or "none" for each in outcomes if name not in each.named)
        instead = ", ".join(f"{other} {count}" for other, count in others.items())
        worst = float(np.median([each.worst for each in outcomes]))
        rows.append((name, f"{named} of {len(seeds)}", instead, f"{worst:.1f}"))
        figures.append(
            Figure(f"{name}: named, of {len(seeds)}", named, "at least", case.least * len(seeds) / 15)
        )
    accused = sum(bool(study_clean(seed).named) for seed in clean)
    figures.append(Figure.none(f"of {len(clean)} clean campaigns, causes named", accused))
    return [
        Section(
            title=f"{len(seeds)} campaigns with each cause of the load's path; {len(clean)} clean ones",
            columns=("planted", "named", "named instead", "worst joint after the mend, median [u]"),
            rows=tuple(rows),
            figures=tuple(figures),
            notes=("clean: half with loads of three sizes, half with a scatter of 20 µrad",),
        )
    ]
