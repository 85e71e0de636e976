"""Runs: the program in a process of its own, so that Ctrl-C and notebooks' "interrupt" stop it and its memory goes with it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from . import _native
from ._errors import ConfigurationError, RunError, of_code
from ._results import City, read


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


def run(
    config: str | os.PathLike[str] | Mapping[str, Any],
    *,
    output: str | os.PathLike[str] | None = None,
    settings: Mapping[str, Any] | None = None,
    threads: int | None = None,
    tell: Callable[[Progress], None] | None = None,
) -> City:
    """Finds the heights of a configuration's buildings, as ``sizeup run`` does, and reads the result.

    Args:
        config: A configuration file, or the same as nested mappings; their paths are relative to the working folder.
        output: Folder of the results, in place of the configuration's.
        settings: Single keys over it, such as ``{"optimise.preset": "paper"}``.
        threads: Threads to use; by default all cores. The result does not depend on it.
        tell: Told how far it is, in the calling thread. An error in it stops the run.

    Raises:
        ConfigurationError: a setting is unknown, contradicts another, or is missing.
        InputError: the input as a whole cannot be used. Single photos and buildings that cannot be used are in the result.
        RunError: the run failed.
    """
    text = None if isinstance(config, (str, os.PathLike)) else _native.toml_of_json(_json(config))
    words = ["-" if text is not None else os.fspath(config)]  # type: ignore[arg-type]
    for key, value in (settings or {}).items():
        words += ["--set", f"{key}={value if isinstance(value, str) else _json(value)}"]
    if output is not None:
        words += ["--output", os.fspath(output)]
    if threads is not None:
        words += ["--threads", str(threads)]
    summary = _call(["run", *words], text, tell)
    return read(Path(summary["output"]))


def _json(value: Any) -> str:
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


def _call(arguments: Sequence[str], text: str | None, tell: Callable[[Progress], None] | None) -> Any:
    """Runs the program; what it prints as JSON."""
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
        elif event["event"] != "done" and tell is not None:
            tell(Progress(**event))
    process.wait()
    reader.join()
    try:
        return json.loads("".join(printed))
    except ValueError:
        ended = f"the program ended with code {process.returncode}"
        raise RunError(f"{ended} and said:\n{''.join(said).strip() or 'nothing'}") from None


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
