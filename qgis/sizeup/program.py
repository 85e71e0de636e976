"""The program `sizeup`: finding it, and running it with progress and cancel. Knows nothing of QGIS."""

import functools
import json
import os
import queue
import re
import shutil
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence

# Oldest program that this plugin can talk to.
LEAST_VERSION = (0, 1, 0)
# How long a program that was asked to stop may take, seconds.
PATIENCE_S = 5.0
# Between two looks at whether to stop, seconds.
POLL_S = 0.1

INSTALL_HINT = (
    "Install sizeup (build it with `cargo install --locked --path .` in a clone of its repository), then name the file "
    "in Settings > Options > Processing > Providers > sizeup > “sizeup program”."
)

Event = Dict[str, Any]


class ProgramError(Exception):
    """The program is absent, unsuitable, or could not do what was asked; the text is for people."""


class Cancelled(Exception):
    """The user stopped the program."""


@dataclass
class Outcome:
    """What a program left behind when it ended."""

    code: int
    stdout: str
    messages: List[str] = field(default_factory=list)


def find(setting: str) -> str:
    """The program's file: what the setting names, else the one on the path or where cargo installs.

    Raises ProgramError where there is none.
    """
    if setting.strip():
        named = Path(setting.strip()).expanduser()
        found = shutil.which(str(named))
        if found:
            return found
        raise ProgramError(f"“{named}”, which the setting “sizeup program” names, is no program. {INSTALL_HINT}")
    name = "sizeup.exe" if sys.platform == "win32" else "sizeup"
    places = [shutil.which("sizeup"), str(Path.home() / ".cargo" / "bin" / name)]
    for place in places:
        if place and shutil.which(place):
            return place
    raise ProgramError(f"The program sizeup was not found. {INSTALL_HINT}")


def check(program: str) -> str:
    """The program's version, such as `0.1.0`.

    Raises ProgramError where it is something else, too old, or does not start.
    """
    answer = _ask(program, ["--version"])
    match = re.match(r"^sizeup (\d+)\.(\d+)\.(\d+)", answer.stdout.strip())
    if answer.returncode != 0 or match is None:
        said = (answer.stdout or answer.stderr).strip().splitlines()
        raise ProgramError(f"“{program}” is not sizeup; it says: {said[0] if said else 'nothing'}. {INSTALL_HINT}")
    version = ".".join(match.groups())
    # The option came without a new number: ask for it too.
    speaks = _ask(program, ["--progress", "json", "--version"]).returncode == 0
    if tuple(map(int, match.groups())) < LEAST_VERSION or not speaks:
        least = ".".join(map(str, LEAST_VERSION))
        raise ProgramError(
            f"“{program}” is sizeup {version}, which is too old for this plugin: it needs {least} or newer, with "
            f"`--progress json`. {INSTALL_HINT}"
        )
    return version


@functools.lru_cache(maxsize=None)
def profiles(program: str) -> List[str]:
    """Names of the profiles of depth networks that the program has. Raises ProgramError where it does not start."""
    try:
        rows = json.loads(_ask(program, ["model", "list", "--json"]).stdout)
        # A network that comes within the program is of another kind: it finds footprints.
        return [row["network"]["name"] for row in rows if row["in_place"] != "built in"]
    except (ValueError, KeyError, TypeError):
        return []


def run(
    program: str,
    arguments: Sequence[str],
    on_event: Callable[[Event], None],
    is_cancelled: Callable[[], bool],
) -> Outcome:
    """Runs the program with `--progress json`, hands on what it tells, and waits until it ends.

    Raises Cancelled where it was stopped, ProgramError with message and hint where it failed. Exit codes 3 and 5 of
    commands that say `done` are outcomes, not failures.
    """
    command = [program, "--progress", "json", *arguments]
    try:
        process = subprocess.Popen(  # noqa: S603, the user names the program
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **_quietly()
        )
    except OSError as error:
        raise ProgramError(f"“{program}” does not start: {error}") from error
    lines: "queue.Queue[Optional[str]]" = queue.Queue()
    stdout: List[bytes] = []
    readers = [
        threading.Thread(target=_read_lines, args=(process.stderr, lines), daemon=True),
        threading.Thread(target=lambda: stdout.append(process.stdout.read()), daemon=True),
    ]
    for reader in readers:
        reader.start()
    try:
        last, messages = _follow(process, lines, on_event, is_cancelled)
        code = process.wait()
    finally:
        for reader in readers:
            reader.join(PATIENCE_S)
        process.stdout.close()
        process.stderr.close()
    text = b"".join(stdout).decode("utf-8", "replace")
    if last is not None and last.get("event") == "done":
        return Outcome(code, text, messages)
    raise ProgramError(_failure(code, last, messages))


def _follow(process, lines, on_event, is_cancelled):
    """Hands events on until there are no more; the last one that ends a command, and the messages."""
    last: Optional[Event] = None
    messages: List[str] = []
    while True:
        if is_cancelled():
            stop(process)
            raise Cancelled()
        try:
            line = lines.get(timeout=POLL_S)
        except queue.Empty:
            continue
        if line is None:
            return last, messages
        event = parse(line)
        if event["event"] in ("done", "error"):
            last = event
        elif event["event"] == "message":
            messages.append(event["message"])
        on_event(event)


def parse(line: str) -> Event:
    """A line of progress; what is no event (libraries print too) is a message."""
    try:
        event = json.loads(line)
    except ValueError:
        event = None
    if isinstance(event, dict) and isinstance(event.get("event"), str):
        return event
    return {"event": "message", "level": "info", "message": line}


def stop(process: "subprocess.Popen[bytes]") -> None:
    """Asks the process to end, and ends it where it does not."""
    process.terminate()
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _failure(code: int, last: Optional[Event], messages: List[str]) -> str:
    if last is not None:
        hint = last.get("hint")
        return f"{last.get('message', '')}\n{hint}" if hint else str(last.get("message", ""))
    told = "\n".join(messages[-5:])
    how = f"signal {-code}" if code < 0 else f"code {code}"
    return f"sizeup ended unexpectedly ({how}).\n{told}".strip()


def _read_lines(pipe, lines) -> None:
    for line in iter(pipe.readline, b""):
        text = line.decode("utf-8", "replace").rstrip()
        if text:
            lines.put(text)
    lines.put(None)


def _ask(program: str, arguments: List[str]) -> "subprocess.CompletedProcess[str]":
    try:
        return subprocess.run(  # noqa: S603, the user names the program
            [program, *arguments], stdin=subprocess.DEVNULL, capture_output=True, timeout=60, text=True,
            encoding="utf-8", errors="replace", **_quietly(),
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ProgramError(f"“{program}” does not start: {error}. {INSTALL_HINT}") from error


def _quietly() -> Dict[str, Any]:
    """No console window on Windows; the environment without what is for QGIS's own Python."""
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONHOME", "PYTHONPATH", "RUST_LOG")}
    flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)
    return {"env": environment, "creationflags": flags}
