"""How many examples Hypothesis draws: a share by default, all of them under `--hypothesis-profile=full`."""

from typing import Any

from hypothesis import settings

FULL = "full"
SHARE, LEAST = 10, 6

settings.register_profile(FULL, deadline=None)


def is_full() -> bool:
    """Tell whether it is the nightly run, which draws all examples."""
    return settings.get_current_profile_name() == FULL


def examples(count: int, **options: Any) -> settings:
    """Settings of a property: `count` examples in the nightly run, a tenth of them otherwise; no deadline."""
    drawn = count if is_full() else min(count, max(count // SHARE, LEAST))
    return settings(max_examples=drawn, deadline=None, **options)
