"""Heights from arrays in memory: the method alone, without files.

| frame | axes | unit |
|---|---|---|
| map | easting, northing, up in a projected CRS | metres |
| camera | x right, y down, z forward | metres |
| image | the top-left pixel's centre is (0.5, 0.5) | pixels |
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from . import _native
from ._errors import ConfigurationError, InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Camera:
    """Intrinsics of a camera, in pixels of the photo's own size."""

    width_px: int
    height_px: int
    fx_px: float
    """Focal length."""
    fy_px: float | None = None
    """Vertical focal length, where it differs."""
    cx_px: float | None = None
    """Principal point from the left edge; the middle by default."""
    cy_px: float | None = None
    """Principal point from the top edge; the middle by default."""
    distortion: Mapping[str, Any] | None = None
    """``k1, k2, k3, p1, p2`` of OpenCV's model (those left out are 0), or another ``model`` with all its coefficients:
    ``rational``, ``fisheye`` (both OpenCV's), ``brown_affine`` (Metashape's), ``fisheye_series`` (Pix4D's)."""

    def _facts(self) -> dict[str, Any]:
        lens = dict(self.distortion) if self.distortion else {"model": "none"}
        if "model" not in lens:
            lens = {"model": "brown", "k1": 0.0, "k2": 0.0, "k3": 0.0, "p1": 0.0, "p2": 0.0, **lens}
        return {
            "width_px": self.width_px,
            "height_px": self.height_px,
            "fx_px": self.fx_px,
            "fy_px": self.fx_px if self.fy_px is None else self.fy_px,
            "cx_px": self.width_px / 2 if self.cx_px is None else self.cx_px,
            "cy_px": self.height_px / 2 if self.cy_px is None else self.cy_px,
            "distortion": lens,
        }


@dataclass(frozen=True)
class Pose:
    """Where a photo was taken from: ``p_camera = rotation @ p_map + translation``."""

    rotation: ArrayLike
    """3 × 3, orthonormal, determinant 1."""
    translation: ArrayLike
    """Where the map's origin lies in the camera's frame, metres."""

    @classmethod
    def from_centre(cls, rotation: ArrayLike, centre: ArrayLike) -> Pose:
        """From the rotation from map to camera, and the projection centre in the map."""
        r, c = _rows(rotation, 3, "rotation"), _numbers(centre, 3, "centre")
        return cls(r, [-sum(a * b for a, b in zip(row, c)) for row in r])

    @classmethod
    def looking_at(cls, eye: ArrayLike, target: ArrayLike) -> Pose:
        """At ``eye``, looking at ``target`` with a level horizon; north is up in a photo that looks straight down."""
        e, t = _numbers(eye, 3, "eye"), _numbers(target, 3, "target")
        forward = _unit([b - a for a, b in zip(e, t)]) or [0.0, 0.0, -1.0]
        right = _unit(_cross(forward, [0.0, 0.0, 1.0])) or [1.0, 0.0, 0.0]
        return cls.from_centre([right, _cross(forward, right), forward], e)


@dataclass(frozen=True)
class View:
    """A photo: its camera, its pose, and the depth that a network or a matcher sees in it."""

    name: str
    """Unique among the views: random choices about a view depend on it, never on its place in the list."""
    camera: Camera
    camera_from_map: Pose
    depth: ArrayLike | None = None
    """Rows × columns, of any size and the photo's shape; NaN where there is none. Only its order, or its values up to scale
    and shift, are trusted. Without depth the view has no say."""
    kind: Literal["depth", "inverse_depth"] = "depth"
    """``depth``: higher is farther; ``inverse_depth``: higher is nearer. Never guessed."""
    geometry: Literal["z_depth", "range"] = "z_depth"
    """Along the optical axis, or along the ray."""
    photo: ArrayLike | None = None
    """Grey levels, rows × columns, of any size and the photo's shape. Photos refine the roofs; the program reduces them to 2,000
    pixels on the longer side."""


@dataclass(frozen=True)
class Grid:
    """A terrain model."""

    heights_m: ArrayLike
    """Rows × columns at cell centres, row 0 the northernmost; NaN where there is none."""
    west_m: float
    """Western edge of the first cell."""
    north_m: float
    """Northern edge of the first cell."""
    cell_m: float | tuple[float, float]
    """Size of a cell, or its width and height."""


@dataclass(frozen=True)
class Part:
    """A part of a building at one roof level; most buildings have one part."""

    rings: Sequence[Sequence[Sequence[float]]]
    """Footprint of the part, easting and northing in metres: the exterior, then holes."""
    height_m: float | None
    """Metres above the ground of the building; ``None`` if no view shows it."""
    sigma_m: float | None
    """One standard deviation, where it can be estimated."""
    roof: Mapping[str, Any] | None
    """The roof that the depths support."""
    score: float | None
    """How well the depths agree with the height, −1 (opposite) to 1."""


@dataclass(frozen=True)
class Height:
    """The height of one building."""

    height_m: float | None
    """Metres above its ground, mean over the area of its parts; ``None`` if no view shows it."""
    sigma_m: float | None
    """One standard deviation, where it can be estimated."""
    reasons: tuple[str, ...]
    """Why it is doubtful or unknown: ``seen_by_no_view``, ``too_few_views``, ``range_bound``, …."""
    views: tuple[int, ...]
    """Positions of the views used."""
    parts: tuple[Part, ...]
    """The building in parts, where its roof has several levels; one part otherwise."""


def estimate_heights(
    footprints: Sequence[Any],
    views: Sequence[View],
    *,
    ground_m: float | Sequence[float],
    terrain: Grid | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> list[Height]:
    """One height per footprint, from poses and depth maps in memory.

    Args:
        footprints: Polygons in the map frame, metres. Each is an ``n × 2`` array, a list of such (exterior, then holes), a
            GeoJSON ``Polygon``, or anything with ``__geo_interface__``, as Shapely's polygons.
        views: Photos with poses and depths. Heights are measured in oblique ones.
        ground_m: Ground level, one for all or one per footprint, metres in the map's vertical datum.
        terrain: The ground's surface; by default level, at the median of ``ground_m``.
        settings: Tables ``heights``, ``optimise`` and ``refinement`` of a configuration, such as ``{"heights": {"max_m": 60}}``.
        seed: Root of random choices: the same gives the same heights.

    Raises:
        InputError: an array has not the shape it should have, or a footprint or a pose is none.
        ConfigurationError: ``settings`` has a key or value that is not known.
    """
    rings = [_rings(footprint, f"footprints[{i}]") for i, footprint in enumerate(footprints)]
    ground = _ground(ground_m, len(rings))
    names = [view.name for view in views]
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise InputError(f"views: {', '.join(twice)} more than once", "names of views are unique")
    depths = [_raster(view.depth, f"views[{i}] ({view.name!r}): depth") for i, view in enumerate(views)]
    photos = [_raster(view.photo, f"views[{i}] ({view.name!r}): photo") for i, view in enumerate(views)]
    surface = None if terrain is None else _raster(terrain.heights_m, "terrain")
    tables = dict(settings or {})
    question = {
        "ground_m": [[z, z] for z in ground],
        "views": [_view(view, i, depths[i], photos[i]) for i, view in enumerate(views)],
        "level_m": sorted(ground)[len(ground) // 2] if ground else 0.0,
        "grid": None if terrain is None or surface is None else _grid(terrain, surface[0]),
        "heights": tables.pop("heights", {}),
        "optimise": tables.pop("optimise", {}),
        "refinement": tables.pop("refinement", {}),
        "seed": seed,
    }
    if tables:
        raise ConfigurationError(f"settings: unknown {', '.join(map(repr, tables))}", "tables are heights, optimise and refinement")
    answer = _native.estimate_heights(
        _json(question),
        rings,
        [depth and depth[1] for depth in depths],
        [photo and photo[1] for photo in photos],
        surface and surface[1],
    )
    return [_height(height) for height in json.loads(answer)]


KINDS = ("depth", "inverse_depth")
GEOMETRIES = ("z_depth", "range")
_Raster = tuple[tuple[int, int], bytes]


def _height(found: Mapping[str, Any]) -> Height:
    return Height(
        height_m=found["height_m"],
        sigma_m=found["sigma_m"],
        reasons=tuple(found["reasons"]),
        views=tuple(found["views"]),
        parts=tuple(
            Part(part["rings"], part["height_m"], part["sigma_m"], part["roof"], part["score"]) for part in found["parts"]
        ),
    )


def _view(view: View, i: int, depth: _Raster | None, photo: _Raster | None) -> dict[str, Any]:
    where = f"views[{i}] ({view.name!r}): camera_from_map"
    for field, found, known in (("kind", view.kind, KINDS), ("geometry", view.geometry, GEOMETRIES)):
        if found not in known:
            raise InputError(
                f"views[{i}] ({view.name!r}): {field}: expected {' or '.join(known)}, found {found!r}",
                "what the depths mean is declared, never guessed",
            )
    return {
        "name": view.name,
        "camera": view.camera._facts(),
        "rotation": _rows(view.camera_from_map.rotation, 3, f"{where}.rotation"),
        "translation": _numbers(view.camera_from_map.translation, 3, f"{where}.translation"),
        "kind": view.kind,
        "geometry": view.geometry,
        "shape": None if depth is None else depth[0],
        "photo_shape": None if photo is None else photo[0],
    }


def _grid(terrain: Grid, shape: tuple[int, int]) -> dict[str, Any]:
    x, y = terrain.cell_m if isinstance(terrain.cell_m, tuple) else (terrain.cell_m, terrain.cell_m)
    return {"shape": shape, "west_m": terrain.west_m, "north_m": terrain.north_m, "cell_x_m": x, "cell_y_m": y}


def _ground(ground_m: float | Sequence[float], n: int) -> list[float]:
    found = _array(ground_m, "ground_m", "f8")
    levels = [float(found)] * n if found.ndim == 0 else [float(level) for level in found.flat]
    if found.ndim > 0 and found.shape != (n,):
        raise InputError(
            f"ground_m: expected one number or {n}, one per footprint, found shape {found.shape}",
            "sample the terrain at each footprint, in their order",
        )
    for i, level in enumerate(levels):
        if not math.isfinite(level):
            raise InputError(f"ground of footprints[{i}]: expected metres, found {level}", "leave out footprints without ground")
    return levels


def _rings(footprint: Any, where: str) -> list[bytes]:
    """Rings of a footprint as bytes, the exterior first."""
    geometry = getattr(footprint, "__geo_interface__", footprint)
    if isinstance(geometry, Mapping) and geometry.get("type") == "Feature":
        geometry = geometry["geometry"]
    if isinstance(geometry, Mapping):
        if geometry.get("type") != "Polygon":
            raise InputError(
                f"{where}: expected a Polygon, found {geometry.get('type')}",
                "give each piece of a MultiPolygon as a footprint of its own",
            )
        rings = geometry["coordinates"]
    else:
        rings = geometry if _is_list_of_rings(geometry) else [geometry]
    return [_ring(ring, where) for ring in rings]


def _is_list_of_rings(value: Any) -> bool:
    """Whether it is rings, and not one ring: something in a list whose own items are points."""
    try:
        return hasattr(value[0][0], "__len__")
    except (TypeError, IndexError, KeyError):
        return False


def _ring(ring: Any, where: str) -> bytes:
    corners = _array(ring, where, "f8")
    if corners.ndim != 2 or corners.shape[1] not in (2, 3):
        raise InputError(
            f"{where}: expected an n × 2 array of easting and northing, found shape {corners.shape}",
            "a list of corners [[e, n], …], or of rings of them",
        )
    return bytes(corners[:, :2].tobytes())


def _raster(values: ArrayLike | None, where: str) -> _Raster | None:
    if values is None:
        return None
    raster = _array(values, where, "f4")
    if raster.ndim != 2 or 0 in raster.shape:
        raise InputError(
            f"{where}: expected rows × columns of numbers, found shape {raster.shape}",
            "one channel, no batch axis: depth.squeeze() takes axes of length 1 away",
        )
    return (raster.shape[0], raster.shape[1]), raster.tobytes()


def _array(values: Any, where: str, kind: str) -> Any:
    try:
        import numpy
    except ImportError as error:
        raise ImportError("arrays need NumPy\nhint: pip install numpy") from error
    try:
        return numpy.ascontiguousarray(values, dtype=f"<{kind}") if numpy.ndim(values) else numpy.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: expected an array of numbers: {error}", "rows of equal length, numbers only") from error


def _rows(values: Any, n: int, where: str) -> list[list[float]]:
    found = _array(values, where, "f8")
    if found.shape != (n, n):
        raise InputError(f"{where}: expected {n} × {n} numbers, found shape {found.shape}", "Pose.looking_at makes a pose")
    return [_finite(row, where) for row in found]


def _numbers(values: Any, n: int, where: str) -> list[float]:
    found = _array(values, where, "f8")
    if found.shape != (n,):
        raise InputError(f"{where}: expected {n} numbers, found shape {found.shape}", "a flat list, metres")
    return _finite(found, where)


def _finite(values: Any, where: str) -> list[float]:
    numbers = [float(x) for x in values]
    if not all(map(math.isfinite, numbers)):
        raise InputError(f"{where}: expected finite numbers, found {numbers}", "leave out photos without a pose")
    return numbers


def _json(question: Any) -> str:
    try:
        return json.dumps(question, allow_nan=False)
    except (TypeError, ValueError) as error:
        hint = "finite plain numbers and text: int(…) or float(…) of NumPy's"
        raise InputError(f"cameras and settings: {error}", hint) from error


def _unit(vector: list[float]) -> list[float] | None:
    length = math.sqrt(sum(x * x for x in vector))
    return [x / length for x in vector] if length > 0 else None


def _cross(a: list[float], b: list[float]) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
