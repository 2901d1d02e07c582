"""Peak memory of identify beyond its inputs, in processes of their own: it must not grow with the data."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.campaigns import default_settings, large_campaign
from benchmarks.report import Figure, Section
from jointstiff.solver.fit.identify import identify
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.measurements import Measurements

__all__ = ["run"]

SIZES = (100_000, 1_000_000)
_MEGABYTE = 1e6


@dataclass(frozen=True)
class Peak:
    """Megabytes of one process."""

    configurations: int  # that were identified
    inputs: float  # size of the arrays in `Measurements`
    before: float  # greatest resident size until the inputs were there
    after: float  # greatest resident size until the estimate was there

    @property
    def beyond_inputs(self) -> float:
        """All that the process ever held, but for the inputs."""
        return self.after - self.inputs


def run(*, quick: bool) -> list[Section]:
    """Compare the peaks of a large campaign and of one ten times as large."""
    small, large = (_in_child(size // 100 if quick else size) for size in SIZES)
    growth = large.beyond_inputs - small.beyond_inputs
    rows = tuple(
        (f"{peak.configurations:,}", *(f"{value:.0f} MB" for value in _values(peak)))
        for peak in (small, large)
    )
    what = f"peak memory at {large.configurations:,} beside {small.configurations:,}, inputs aside"
    return [
        Section(
            title="Peak memory, each in a fresh process",
            columns=("configurations", "inputs", "peak before identify", "peak after", "peak − inputs"),
            rows=rows,
            figures=(Figure(what, abs(growth), "at most", 300.0, " MB"),),
            notes=(
                "all libraries and the making of the inputs, block by block, count, so that the peak after "
                "identify can only be too large",
            ),
            data={"peaks": [asdict(small), asdict(large)]},
        )
    ]


def _values(peak: Peak) -> tuple[float, ...]:
    return peak.inputs, peak.before, peak.after, peak.beyond_inputs


def _in_child(configurations: int) -> Peak:
    command = [sys.executable, "-m", "benchmarks.performance.memory", str(configurations)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return Peak(**json.loads(done.stdout))


def _measure(configurations: int) -> Peak:
    campaign = large_campaign(configurations)
    before = _greatest_resident_size()
    identify(Rows(campaign.robot, campaign.measurements), default_settings(campaign.robot))
    return Peak(configurations, _size(campaign.measurements), before, _greatest_resident_size())


def _size(measurements: Measurements) -> float:
    arrays = [value for value in vars(measurements).values() if isinstance(value, np.ndarray)]
    return sum(array.nbytes for array in arrays) / _MEGABYTE


def _greatest_resident_size() -> float:
    """Return the largest resident size of this process [MB].

    Not `ru_maxrss`: a child that was spawned without copying its parent inherits the parent's peak (Linux
    books it at exec), and the parent may have been large.
    """
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    kilobytes = next(line.split()[1] for line in lines if line.startswith("VmHWM"))
    return int(kilobytes) * 1024 / _MEGABYTE


if __name__ == "__main__":
    print(json.dumps(asdict(_measure(int(sys.argv[1])))))
