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
    held, alone, widths, refused = [], [], [], 0
    for seed in seeds:
        simulated = simulate(seed, is_slow=name == "slow sweeps", logs=LOGS[name])
        result = identify_from_logs(read(simulated.document))
        for joint, gearbox in zip(JOINTS, result.gearboxes, strict=True):
            if gearbox.stiffness_interval is None or gearbox.half_width is None:
                refused += 1
                continue
            true = simulated.stiffness[joint]
            held.append(_contains(gearbox.stiffness_interval, true))
            of_logs = [each.stiffness_interval for each in result.by_log if each.joint == gearbox.joint]
            alone += [_contains(interval, true) for interval in of_logs]
            widths.append(gearbox.half_width)
    share, width = 100.0 * float(np.mean(held)), 100.0 * float(np.median(widths))
    share_alone = 100.0 * float(np.mean(alone))
    return Section(
        title=f"Logs of {len(seeds)} arms, {name}, joints 1 to 3",
        columns=("held", "of", "refused", "half-width, median [%]", "each log alone: held", "of"),
        rows=(
            (f"{sum(held)}", f"{len(held)}", f"{refused}", f"{width:.1f}", f"{sum(alone)}", f"{len(alone)}"),
        ),
        figures=(
            Figure(f"logs, {name}: intervals with the truth", share, "at least", 92.5, " %"),
            Figure(f"each log alone, {name}: intervals with the truth", share_alone, "at least", 92.5, " %"),
        ),
    )


def _contains(interval: tuple[float, float | None], true: float) -> bool:
    """Return whether an interval, whose upper end may be open, contains what is true."""
    lower, upper = interval
    return lower <= true and (upper is None or true <= upper)
