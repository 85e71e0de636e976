"""How far a command is, from its events. Knows nothing of QGIS."""

import time
from typing import Any, Callable, Dict, Optional, Tuple

# Before this share of a run is done, and before these seconds, the time left is not known.
LEAST_SHARE, LEAST_S = 0.05, 5.0
# Shares of a run whose passing is worth a line, beside the stages.
QUARTERS = (0.25, 0.5, 0.75)


class Progress:
    """Percent of a command, and what a log should have of it: a line for each stage and each quarter."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.percent = 0.0
        self._clock, self._began = clock, clock()
        self._work = ""
        self._is_run = False

    def take(self, event: Dict[str, Any]) -> Optional[str]:
        """Takes an event in; the stage or work that begins with it, or `quarter` where one is passed, or None."""
        before = self.percent
        if event.get("event") == "done":
            self.percent = 100.0
        if event.get("event") == "stage":
            self._is_run = True
            self._reach(event.get("share", 0.0))
            return self._begins(str(event.get("stage", "")))
        if event.get("event") != "advance":
            return None
        if event.get("share") is not None:
            self._reach(event["share"])
            is_passed = any(before < 100.0 * quarter <= self.percent for quarter in QUARTERS)
            return "quarter" if is_passed else None
        if event.get("total", 0) > 0 and not self._is_run:
            self._reach(event.get("done", 0) / event["total"])
        return self._begins(str(event.get("what", "")))

    def left_s(self) -> Optional[float]:
        """Seconds left if it goes on as so far; None where that is not known."""
        share, took_s = self.percent / 100.0, self._clock() - self._began
        if not self._is_run or share < LEAST_SHARE or took_s < LEAST_S:
            return None
        return took_s * (1.0 - share) / share

    def _begins(self, work: str) -> Optional[str]:
        """A name where it is not the last one: logs want a line each, not one for every step."""
        is_new, self._work = work != self._work, work
        return work if is_new else None

    def _reach(self, share: float) -> None:
        self.percent = max(self.percent, 100.0 * min(share, 1.0))
