"""The program in a process of its own, so that Ctrl-C and notebooks' "interrupt" stop it and its memory goes with it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from ._errors import ConfigurationError, RunError, of_code


@dataclass(frozen=True)
class Progress:
    """What a run tells while it works."""

    event: str
    """``stage``, ``advance`` or ``message``."""
    stage: str | None = None
    """The stage that begins: ``survey``, ``footprints``, ``heights``, ``output``."""
    what: str | None = None
    """The work that goes on."""
    done: int | None = None
    """How much of it is done."""
    total: int | None = None
    """How much there is."""
    share: float | None = None
    """Share of the whole run that is done, 0 to 1."""
    level: str | None = None
    """How much a message weighs: ``info``, ``warning``, ``error``."""
    message: str | None = None
    """Its text."""


def as_json(value: Any) -> str:
    try:
        return json.dumps(value, default=_plain)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(
            f"the configuration cannot be written down: {error}",
            "values are text, paths, numbers, true or false, lists and mappings; leave out what is None",
        ) from error


def _plain(value: object) -> str:
    if isinstance(value, os.PathLike):
        return str(os.fspath(value))
    raise TypeError(f"{type(value).__name__} is no setting")


def options(**named: Any) -> list[str]:
    """Keywords as options of the command line: ``None`` and ``False`` are left out, ``True`` is a flag, lists have commas."""
    words = []
    for name, value in named.items():
        option = f"--{name.replace('_', '-')}"
        if value is True:
            words.append(option)
        elif value is not None and value is not False:
            items = [value] if isinstance(value, (str, os.PathLike)) or not hasattr(value, "__iter__") else list(value)
            words.append(f"{option}={','.join(str(item) for item in items)}")
    return words


def call(arguments: Sequence[str], text: str | None = None, tell: Callable[[Progress], None] | None = None) -> Any:
    """Runs the program and returns what it prints as JSON. Its warnings become Python's."""
    command = [*_program(), *arguments, "--json", "--progress", "json"]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL if text is None else subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
    ) as process:
        try:
            return _listen(process, text, tell)
        except BaseException:
            process.kill()
            raise


def _listen(process: subprocess.Popen[str], text: str | None, tell: Callable[[Progress], None] | None) -> Any:
    assert process.stdout is not None and process.stderr is not None
    if process.stdin is not None:
        process.stdin.write(text or "")
        process.stdin.close()
    # Both pipes are emptied at the same time: a full one would stop the program.
    printed: list[str] = []
    reader = threading.Thread(target=_gather, args=(process.stdout, printed), daemon=True)
    reader.start()
    said: list[str] = []
    for line in process.stderr:
        event = _event(line)
        if event is None:
            said.append(line)
        elif event["event"] == "error":
            raise of_code(event["code"], event["message"], event.get("hint"))
        elif event["event"] != "done":
            if event.get("level") == "warning":
                warn(event["message"])
            if tell is not None:
                tell(Progress(**event))
    process.wait()
    reader.join()
    try:
        return json.loads("".join(printed))
    except ValueError:
        ended = f"the program ended with code {process.returncode}"
        raise RunError(f"{ended} and said:\n{''.join(said).strip() or 'nothing'}") from None


def warn(message: str) -> None:
    """Warns at the line that called this package, however deep in it this is."""
    depth, frame = 1, sys._getframe()
    while frame is not None and frame.f_globals.get("__package__") == __package__:
        depth, frame = depth + 1, frame.f_back  # type: ignore[assignment]
    warnings.warn(message, stacklevel=depth)


def _gather(stream: IO[str], into: list[str]) -> None:
    into.append(stream.read())


def _event(line: str) -> dict[str, Any] | None:
    try:
        event = json.loads(line)
    except ValueError:
        return None
    return event if isinstance(event, dict) and "event" in event else None


def _program() -> list[str]:
    """This package as a program. Inside another program (QGIS) Python's own name is not known: the script is."""
    python = sys.executable
    if python and Path(python).name.lower().startswith(("python", "pypy")):
        return [python, "-m", "sizeup"]
    return ["sizeup"]
