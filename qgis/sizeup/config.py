"""The configuration file of a run, `sizeup.toml`, from plain values. Knows nothing of QGIS.

Keys are those of `sizeup schema run`. Paths are made absolute: the file does not lie where the data is.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple, Union

Table = Dict[str, Any]

PRIOR_SOURCES = ("auto", "stereo", "files", "network")
PRIOR_KINDS = ("depth", "inverse_depth")
MASK_KINDS = ("instance", "semantic", "probability", "coco")

_BARE_KEY = re.compile(r"^[A-Za-z0-9_-]+$")
_ESCAPES = {"\\": "\\\\", '"': '\\"', "\b": "\\b", "\t": "\\t", "\n": "\\n", "\f": "\\f", "\r": "\\r"}


class ConfigError(ValueError):
    """Settings that contradict each other or are missing; the text is for people."""


@dataclass(frozen=True)
class Layer:
    """A vector layer in a file."""

    path: str
    layer: Optional[str] = None
    id_field: Optional[str] = None

    def table(self) -> Table:
        return _without_none({"path": absolute(self.path), "layer": self.layer, "id_field": self.id_field})


@dataclass(frozen=True)
class Masks:
    """Masks of the nadir photos; `{stem}` and `{name}` stand for the photo's name."""

    path: str
    kind: str
    cadastre: Optional[Layer] = None

    def table(self) -> Table:
        if self.kind not in MASK_KINDS:
            raise ConfigError(f"masks of the kind {self.kind!r}: expected one of {', '.join(MASK_KINDS)}")
        table: Table = {"source": "masks", "path": absolute(self.path), "kind": self.kind}
        if self.cadastre is not None:
            table["cadastre"] = self.cadastre.table()
        return table


@dataclass(frozen=True)
class FootprintNetwork:
    """A segmentation network that finds footprints in the nadir photos."""

    model: str
    profile: str
    cadastre: Optional[Layer] = None

    def table(self) -> Table:
        table: Table = {"source": "network", "model": absolute(self.model), "profile": self.profile}
        if self.cadastre is not None:
            table["cadastre"] = self.cadastre.table()
        return table


@dataclass(frozen=True)
class Prior:
    """Where depth comes from."""

    source: str = "auto"
    path: Optional[str] = None
    kind: Optional[str] = None
    model: Optional[str] = None
    profile: Optional[str] = None

    def table(self) -> Table:
        if self.source == "stereo":
            return {"source": "stereo"}
        if self.source == "files":
            if not self.path:
                raise ConfigError("depth from files: say where they are, as in priors/{stem}.npy")
            if self.kind not in PRIOR_KINDS:
                raise ConfigError("depth from files: say whether they are depth or inverse depth")
            return {"source": "files", "path": absolute(self.path), "kind": self.kind}
        if self.source == "network":
            if not self.model:
                raise ConfigError("depth from a network: name its ONNX file, or a network that is in place")
            return {"source": "network", **self._network()}
        if self.source == "auto":
            return {"source": "auto", **self._network()} if self.model else {"source": "auto"}
        raise ConfigError(f"depth from {self.source!r}: expected one of {', '.join(PRIOR_SOURCES)}")

    def _network(self) -> Table:
        # A bare word is the name of a network that the program has put in place, everything else a file.
        is_name = bool(_BARE_KEY.match(self.model or "")) and not Path(self.model or "").exists()
        model = self.model if is_name else absolute(self.model or "")
        return _without_none({"model": model, "profile": self.profile or None})


@dataclass
class RunSettings:
    """What a run needs to know, as people enter it."""

    crs: str
    output: str
    survey: str
    images: Optional[str] = None
    pose_crs: Optional[str] = None
    offset: Optional[Tuple[float, float, float]] = None
    footprints: Union[Layer, Masks, FootprintNetwork, None] = None
    dtm: Optional[str] = None
    ground_m: Optional[float] = None
    prior: Optional[Prior] = None
    vertical_reference: Optional[str] = None
    reviews: Optional[str] = None
    more: List[str] = field(default_factory=list)

    def tables(self) -> Table:
        """The tables of the file.

        Raises ConfigError where something is missing or contradicts something else.
        """
        if not self.survey:
            raise ConfigError("no survey: name the poses' file or folder")
        project = {"crs": self.crs, "output": absolute(self.output), "vertical_reference": self.vertical_reference}
        survey: Table = {"path": absolute(self.survey), "crs": self.pose_crs, "offset": self.offset}
        if self.images:
            survey["images"] = absolute(self.images)
        tables: Table = {"project": _without_none(project), "survey": _without_none(survey)}
        if self.footprints is not None:
            tables["footprints"] = self.footprints.table()
        terrain = self._terrain()
        if terrain:
            tables["terrain"] = terrain
        if self.prior is not None:
            tables["prior"] = self.prior.table()
        if self.reviews:
            tables["reviews"] = {"path": absolute(self.reviews)}
        return tables

    def _terrain(self) -> Table:
        if self.dtm and self.ground_m is not None:
            raise ConfigError("a terrain model and a ground height: give one of the two")
        if self.dtm:
            return {"dtm": absolute(self.dtm)}
        return {} if self.ground_m is None else {"constant_m": float(self.ground_m)}

    def to_toml(self) -> str:
        """The text of `sizeup.toml`."""
        return "# Written by the QGIS plugin.\n" + to_toml(self.tables())

    def assignments(self) -> List[str]:
        """Further settings, `table.key=value`, one `--set` each; empty lines and comments are passed over."""
        return settings_of("\n".join(self.more))


def settings_of(text: str) -> List[str]:
    """Settings of a text, `table.key=value`, one a line; empty lines and comments are passed over."""
    lines = [line.strip() for line in text.splitlines()]
    lines = [line for line in lines if line and not line.startswith("#")]
    for line in lines:
        if "=" not in line.lstrip("="):
            raise ConfigError(f"further settings: {line!r} is not of the form table.key=value")
    return lines


def setting(key: str, value: Any) -> str:
    """One setting as the program's `--set` takes it."""
    return f"{key}={_value(value)}"


def absolute(path: str) -> str:
    """A path from the root, with `/` on every system; templates such as `{stem}` stay as they are."""
    return Path(path).expanduser().absolute().as_posix()


def three_numbers(text: str) -> Optional[Tuple[float, float, float]]:
    """`x, y, z` as numbers; None for an empty text."""
    if not text.strip():
        return None
    try:
        x, y, z = (float(part) for part in re.split(r"[,;]", text))
    except ValueError as error:
        raise ConfigError(f"offset {text!r}: expected three numbers, x, y, z") from error
    return x, y, z


def to_toml(tables: Table) -> str:
    """Tables of tables and values as TOML."""
    lines: List[str] = []
    _write_table((), tables, lines)
    return "\n".join(lines) + "\n"


def _write_table(path: Tuple[str, ...], table: Table, lines: List[str]) -> None:
    values = [(key, value) for key, value in table.items() if not isinstance(value, dict)]
    if path and (values or not table):
        lines += ["", f"[{'.'.join(_key(part) for part in path)}]"]
    lines += [f"{_key(key)} = {_value(value)}" for key, value in values]
    for key, value in table.items():
        if isinstance(value, dict):
            _write_table((*path, key), value, lines)


def _key(key: str) -> str:
    return key if _BARE_KEY.match(key) else _string(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return _string(str(value))


def _string(text: str) -> str:
    def escaped(character: str) -> str:
        if character in _ESCAPES:
            return _ESCAPES[character]
        return f"\\u{ord(character):04X}" if ord(character) < 0x20 or character == "\x7f" else character

    return '"' + "".join(escaped(character) for character in text) + '"'


def _without_none(table: Table) -> Table:
    return {key: value for key, value in table.items() if value is not None}
