"""What is wrong, and what to do about it."""

from __future__ import annotations


class SizeupError(Exception):
    """Something could not be done.

    ``message`` says what, where, what was expected and what was found; ``hint`` what to do about it, where that is known;
    ``code`` is the exit code that the program ends with.
    """

    code: int = 4

    def __init__(self, message: str, hint: str | None = None) -> None:
        super().__init__(message, hint)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return self.message if self.hint is None else f"{self.message}\nhint: {self.hint}"


class ConfigurationError(SizeupError, ValueError):
    """Settings that mean nothing, contradict each other or are missing."""

    code = 2


class InputError(SizeupError, ValueError):
    """Input that cannot be used as a whole: arrays of the wrong shape, files that are no city."""

    code = 3


class RunError(SizeupError, RuntimeError):
    """A run that failed although it was asked well: a full disk, a fault of the program."""

    code = 4


def of_code(code: int, message: str, hint: str | None) -> SizeupError:
    """The error that an exit code stands for."""
    kind = {2: ConfigurationError, 3: InputError}.get(code, RunError)
    return kind(message, hint)
