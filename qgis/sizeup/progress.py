"""How far a run is, from what it tells. Knows nothing of QGIS."""

from typing import Any, Dict, Optional, Tuple

# Where each stage begins and ends, percent of a whole run.
STAGES = {"survey": (0.0, 4.0), "footprints": (4.0, 12.0), "heights": (12.0, 88.0), "output": (88.0, 100.0)}
# Where each work within the heights begins and ends, percent. Rounds begin anew; the bar never goes back.
WORKS = {"tracing": (12.0, 16.0), "priors": (16.0, 46.0), "epochs": (46.0, 88.0), "ground": (4.0, 12.0)}


class Progress:
    """Percent and words of a command, from its events."""

    def __init__(self) -> None:
        self.percent = 0.0
        self._work = ""
        self._stage: Tuple[float, float] = (0.0, 100.0)

    def take(self, event: Dict[str, Any]) -> Optional[str]:
        """Takes an event in; the name of the stage or work that begins with it, if one does."""
        if event.get("event") == "stage":
            self._stage = STAGES.get(event.get("stage", ""), self._stage)
            self._advance(self._stage[0])
            return self._begins(str(event.get("stage", "")))
        if event.get("event") == "advance":
            done, total = event.get("done", 0), event.get("total", 0)
            begin, end = WORKS.get(event.get("what", ""), self._stage)
            if total > 0:
                self._advance(begin + (end - begin) * min(done / total, 1.0))
            return self._begins(str(event.get("what", "")))
        if event.get("event") == "done":
            self._advance(100.0)
        return None

    def _begins(self, work: str) -> Optional[str]:
        """A name where it is not the last one: logs want a line each, not one for every step."""
        is_new, self._work = work != self._work, work
        return work if is_new else None

    def _advance(self, percent: float) -> None:
        self.percent = max(self.percent, percent)
