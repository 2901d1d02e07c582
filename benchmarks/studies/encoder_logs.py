"""Gearboxes from a controller's logs: intervals of arms that swing, and of arms that sweep slowly."""

from __future__ import annotations

import numpy as np

from benchmarks.report import Figure, Part, Section
from jointstiff.solver.gearboxes.log_outcome import identify_from_logs
from tests.support.motion_logs import JOINTS, read, simulate

__all__ = ["run"]

ARMS = 40
LOGS = {"swinging": 3, "slow sweeps": 6}


def run(*, quick: bool, part: Part) -> list[Section]:
    """Count the intervals of simulated arms that contain the truth, and measure their widths."""
    arms = list(part.of(2 if quick else ARMS))
    return [_cover(name, arms) for name in LOGS]


def _cover(name: str, seeds: list[int]) -> Section:
    """Return the section of one kind of motion."""
    held, widths, refused = [], [], 0
    for seed in seeds:
        simulated = simulate(seed, is_slow=name == "slow sweeps", logs=LOGS[name])
        gearboxes = identify_from_logs(read(simulated.document)).gearboxes
        for joint, gearbox in zip(JOINTS, gearboxes, strict=True):
            if gearbox.stiffness_interval is None or gearbox.half_width is None:
                refused += 1
                continue
            lower, upper = gearbox.stiffness_interval
            held.append(lower <= simulated.stiffness[joint] <= (np.inf if upper is None else upper))
            widths.append(gearbox.half_width)
    share, width = 100.0 * float(np.mean(held)), 100.0 * float(np.median(widths))
    return Section(
        title=f"Logs of {len(seeds)} arms, {name}, joints 1 to 3",
        columns=("held", "of", "refused", "half-width, median [%]"),
        rows=((f"{sum(held)}", f"{len(held)}", f"{refused}", f"{width:.1f}"),),
        figures=(Figure(f"logs, {name}: intervals with the truth", share, "at least", 92.5, " %"),),
    )
