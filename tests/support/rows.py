"""Tables of inputs with their wanted outcome, one a line."""

from pathlib import Path

ARROW = " → "


def rows_of(test: str, name: str) -> list[tuple[str, str]]:
    """Return inputs and outcomes of a file beside a test: `input → outcome`, `#` before a remark."""
    lines = Path(test).with_name(name).read_text(encoding="utf-8").splitlines()
    rows = [line.partition(ARROW) for line in lines if line and not line.startswith("#")]
    assert all(outcome for _, _, outcome in rows)
    return [(given, outcome) for given, _, outcome in rows]
