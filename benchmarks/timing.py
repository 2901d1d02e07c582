"""Times of candidates that take turns, and their ratios."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import median, quantiles
from typing import Any

__all__ = ["Times", "interleaved"]


@dataclass(frozen=True)
class Times:
    """Seconds that each candidate took, round by round."""

    seconds: dict[str, list[float]]  # of each candidate, in the order of the rounds
    results: dict[str, Any]  # of each candidate, in the last round

    def median(self, candidate: str) -> float:
        """Median over the rounds [s]."""
        return median(self.seconds[candidate])

    def ratio(self, candidate: str, reference: str) -> float:
        """Median of the candidate over the median of the reference."""
        return self.median(candidate) / self.median(reference)

    def spread(self, candidate: str, reference: str) -> tuple[float, float] | None:
        """Middle half of the ratios within single rounds: how far the ratio is to be trusted.

        None where the two were not timed equally often.
        """
        first, second = self.seconds[candidate], self.seconds[reference]
        if len(first) != len(second) or len(first) < 2:
            return None
        ratios = [a / b for a, b in zip(first, second, strict=True)]
        lower, _, upper = quantiles(ratios, n=4, method="inclusive")
        return lower, upper


def interleaved(candidates: Mapping[str, Callable[[], object]], *, rounds: int, warm_up: int = 1) -> Times:
    """Let the candidates take turns: A B A B ...

    Args:
        candidates: by name.
        rounds: how often each is timed.
        warm_up: rounds before that which do not count.

    Returns:
        The times, and what the candidates returned.
    """
    seconds: dict[str, list[float]] = {name: [] for name in candidates}
    results: dict[str, Any] = {}
    for number in range(warm_up + rounds):
        for name, call in candidates.items():
            start = time.perf_counter()
            results[name] = call()
            elapsed = time.perf_counter() - start
            if number >= warm_up:
                seconds[name].append(elapsed)
    return Times(seconds, results)
