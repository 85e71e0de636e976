"""What a run found, as Python values that GeoPandas, Shapely and the like take as they are."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _native
from ._errors import InputError
from ._export import export as _export
from ._program import warn

if TYPE_CHECKING:
    import geopandas


@dataclass(frozen=True)
class Building:
    """One building, or a part of one: metres, positions in the city's CRS and vertical reference."""

    id: str
    """Unique id, the input's."""
    status: str
    """``measured``, ``reviewed``, ``given``, ``doubtful``, ``fallback``, ``unknown`` or ``refused``."""
    reasons: tuple[str, ...]
    """Why it is not simply measured: ``too_few_views``, ``range_bound``, …, sorted."""
    height_m: float | None
    """Roof level minus ground level."""
    height_sigma_m: float | None
    """One standard deviation of it."""
    height_reference: str
    """Which height of a pitched roof that is: ``mean``, ``eave`` or ``ridge``."""
    ground_z_m: float | None
    """Ground level the height counts from."""
    base_z_m: float | None
    """Lowest ground under the footprint: walls go down to here."""
    roof_z_m: float | None
    """Ground level plus height."""
    roof: Mapping[str, Any] | None
    """The roof that the photos support: ``form``, ``eave_height_m``, ``ridge_height_m``, and where they are known
    ``ridge_azimuth_deg`` of a gable and ``step``, the plan of a stepped one."""
    part_of: str | None
    """The building of the input that this is a part of."""
    views: tuple[str, ...]
    """Names of the photos its height was measured in."""
    attributes: Mapping[str, Any]
    """The input's own attributes."""
    geometry: Mapping[str, Any] | None
    """The footprint as GeoJSON's ``Polygon``; ``None`` where it could not be used."""
    properties: Mapping[str, Any] = field(repr=False)
    """Everything but the footprint as a flat row, the columns of the GeoPackage's layer ``buildings``: the id, all attributes of sizeup,
    then the input's. Lists are text."""

    @property
    def __geo_interface__(self) -> dict[str, Any]:
        return {"type": "Feature", "id": self.id, "geometry": self.geometry, "properties": dict(self.properties)}


@dataclass(frozen=True)
class Solid:
    """A closed solid as triangles, such as ``trimesh.Trimesh(solid.vertices, solid.triangles)`` takes."""

    vertices: list[list[float]]
    """Corners in the city's CRS: x, y, z, metres."""
    triangles: list[list[int]]
    """Three positions among the vertices each, counter-clockwise seen from outside."""
    kinds: list[str]
    """``ground``, ``roof`` or ``wall`` for each triangle."""


@dataclass(frozen=True)
class City:
    """Buildings with what is known of them as a whole. Iterates over its buildings; ``city["id"]`` is one of them."""

    path: Path
    """The file the buildings are from."""
    crs: str | None
    """Their CRS as the file states it, such as ``EPSG:25832``."""
    buildings: tuple[Building, ...]
    """In the order of the file."""
    lineage: Mapping[str, Any] | None = None
    """Version, command, hashed inputs, vertical reference; ``None`` for a file that is not of sizeup."""
    summary: Mapping[str, Any] | None = None
    """The run's counts; ``None`` for a single file."""
    issues: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)
    """What was wrong with single photos and buildings, what matters most first; empty for a single file."""

    def __iter__(self) -> Iterator[Building]:
        return iter(self.buildings)

    def __len__(self) -> int:
        return len(self.buildings)

    def __getitem__(self, id: str) -> Building:
        """The building, or the part of one, with an id. Raises ``KeyError`` if there is none."""
        try:
            return self._by_id[id]
        except KeyError:
            parts = [building.id for building in self.buildings if building.part_of == id]
            hint = f"it is in parts: {', '.join(parts)}" if parts else "`[building.id for building in city]` lists all ids"
            raise KeyError(f"{self.path} has no building {id!r}; {hint}") from None

    def __contains__(self, building: object) -> bool:
        """Whether there is a building with that id, or that building."""
        return building in (self._by_id if isinstance(building, str) else self.buildings)

    @cached_property
    def _by_id(self) -> dict[str, Building]:
        return {building.id: building for building in self.buildings}

    @property
    def __geo_interface__(self) -> dict[str, Any]:
        return {"type": "FeatureCollection", "features": [building.__geo_interface__ for building in self.buildings]}

    def to_geodataframe(self) -> geopandas.GeoDataFrame:
        """A row per building with all attributes, the columns of :attr:`Building.properties`. Needs GeoPandas (``pip install geopandas``)."""
        try:
            import geopandas
        except ImportError as error:
            raise ImportError("a GeoDataFrame needs GeoPandas\nhint: pip install geopandas") from error
        if not self.buildings:
            return geopandas.GeoDataFrame(geometry=[], crs=self.crs)
        return geopandas.GeoDataFrame.from_features(self.__geo_interface__["features"], crs=self.crs)

    def solids(self) -> dict[str, Solid]:
        """The solids by the ids of their buildings: with the roof that was found (LOD 2.0), else the block. Buildings without a height
        have none. They are made from the file at :attr:`path`."""
        return {id: Solid(**solid) for id, solid in json.loads(_native.read_solids(self.path)).items()}

    export = _export
    """:func:`sizeup.export` of the file at :attr:`path`: ``city.export("city.gml")``."""


def read(path: str | os.PathLike[str]) -> City:
    """Reads a city: the folder of a run, its GeoPackage or CityJSON, or anybody's file with heights.

    Warns of results whose writer was killed before its end, or is still at it: they may be of two runs, or of an earlier one.

    Raises:
        InputError: there is no such file, or it holds no buildings that can be read.
    """
    path = Path(path)
    mark = (path if path.is_dir() else path.parent) / "UNFINISHED.txt"
    if mark.is_file():
        told = (mark.read_text(encoding="utf-8").splitlines() or ["its writer has not come to its end"])[0]
        warn(f"{path} is not finished: {told}")
    if path.is_dir():
        return _read_run(path)
    return _read_file(path)


def _read_file(path: Path) -> City:
    found = json.loads(_native.read_city(path))
    buildings = tuple(_building(record, found["columns"]) for record in found["buildings"])
    return City(path=path, crs=found["crs"], buildings=buildings, lineage=found["lineage"])


def _read_run(folder: Path) -> City:
    city = folder / "city.city.json"
    if not city.is_file():
        raise InputError(
            f"{folder} has no city.city.json: expected the folder of a finished run",
            "give the folder that `sizeup run` names at its end, or a file",
        )
    found = _read_file(city)
    summary = _json(folder / "summary.json")
    issues = tuple(_json(folder / "issues.json") or ())
    return City(city, found.crs, found.buildings, found.lineage, summary, issues)


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {error}", "run it again: `sizeup run … --from output`") from error


def _building(record: dict[str, Any], columns: list[str]) -> Building:
    return Building(
        id=record["id"],
        status=record["status"],
        reasons=tuple(record["reasons"]),
        height_m=record["height_m"],
        height_sigma_m=record["height_sigma_m"],
        height_reference=record["height_reference"],
        ground_z_m=record["ground_z_m"],
        base_z_m=record["base_z_m"],
        roof_z_m=record["roof_z_m"],
        roof=record.get("roof"),
        part_of=record.get("part_of"),
        views=tuple(record["views"]),
        attributes=record["attributes"],
        geometry=record["geometry"],
        properties=dict(zip(columns, record["row"], strict=True)),
    )
