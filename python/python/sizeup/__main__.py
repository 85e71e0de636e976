"""The command `sizeup`, and `python -m sizeup`: the same program as the stand-alone binary, in this package's module."""

from __future__ import annotations

import signal
import sys
import sysconfig
from pathlib import Path

from . import _native


def main() -> int:
    """Answers the command line; the number is the exit code."""
    # Rust does not look at Python's flag: Ctrl-C ends the process, as it ends the binary.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    program = _program()
    return _native.answer(program, _native.__file__, [program, *sys.argv[1:]])


def _program() -> str:
    """What starts the command once more: its script, beside this Python."""
    name = "sizeup.exe" if sys.platform == "win32" else "sizeup"
    for folder in (Path(sys.argv[0]).parent, Path(sysconfig.get_path("scripts"))):
        script = folder / name
        if script.is_file():
            return str(script.resolve().parent / name)
    return sys.argv[0]


if __name__ == "__main__":
    sys.exit(main())
