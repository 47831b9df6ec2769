"""What long jobs tell of how far they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

#: Called with the stage, what is done of it and how much that is in all; True: a bar of tqdm.
Progress = Callable[[str, int, int], object] | bool | None


def told(progress: Progress) -> Callable[[str, int, int], object] | None:
    """What the native half calls."""
    if progress is None or progress is False:
        return None
    if progress is not True:
        if not callable(progress):
            raise TypeError("progress: give a function of (stage, done, total), True or None")
        return progress
    try:
        from tqdm.auto import tqdm  # type: ignore[import-untyped]
    except ModuleNotFoundError:
        raise ModuleNotFoundError("progress=True needs tqdm; install it, or give a function") from None
    bars: dict[str, Any] = {}

    def show(stage: str, done: int, total: int) -> None:
        if stage not in bars:
            for bar in bars.values():
                bar.close()
            bars.clear()
            bars[stage] = tqdm(total=total, desc=stage, unit="block")
        bars[stage].update(done - bars[stage].n)
        if done >= total:
            bars[stage].close()

    return show
