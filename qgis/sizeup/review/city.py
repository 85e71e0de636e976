"""The buildings of a result, as the review panel goes through them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional, Tuple

from qgis.core import (
    NULL,
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsFeature,
    QgsGeometry,
    QgsProject,
    QgsRectangle,
    QgsVectorLayer,
)

from ..results import file_of
from .camera import View, read_views

# What makes a layer one of ours.
FIELDS = ("id", "status", "height_m", "height_sigma_m", "ground_z_m", "base_z_m", "reasons", "views")
# Statuses that ask for a look.
TO_LOOK_AT = ("doubtful", "unknown", "fallback")
Ring = List[Tuple[float, float]]


@dataclass(frozen=True)
class Building:
    """One building of a result; metres."""

    id: str
    status: str
    height_m: Optional[float]
    sigma_m: Optional[float]
    ground_z_m: Optional[float]
    base_z_m: Optional[float]
    reasons: List[str]
    views: List[str]
    footprint: QgsGeometry

    @property
    def rings(self) -> List[Ring]:
        """Exterior and holes, closed."""
        polygons = self.footprint.asMultiPolygon() if self.footprint.isMultipart() else [self.footprint.asPolygon()]
        return [[(p.x(), p.y()) for p in ring] for polygon in polygons for ring in polygon]

    @property
    def extent(self) -> QgsRectangle:
        return self.footprint.boundingBox()


class City:
    """A result: its buildings, cameras and issues."""

    def __init__(self, layer: QgsVectorLayer) -> None:
        self.layer = layer
        self.folder: Path = file_of(layer).parent
        self.views: Dict[str, View] = read_views(self.folder)
        self._told = _issues(self.folder)
        self.buildings = [_building(feature) for feature in layer.getFeatures()]

    def why(self, building: Building) -> str:
        """Why a building asks for a look, in words, with what to do about it."""
        told = self._told.get(building.id)
        if told:
            return told
        return "; ".join(reason.replace("_", " ") for reason in building.reasons)

    def views_of(self, building: Building) -> List[View]:
        """The photos that its height was measured in, else all that show it: first those that show the whole block, the largest first."""
        named = [self.views[name] for name in building.views if name in self.views]
        sizes = [(_size_px(view, building), view) for view in (named or self.views.values())]
        shown = [(not _is_whole(view, building), -size, view.name, view) for size, view in sizes if size > 0.0]
        return [view for _, _, _, view in sorted(shown, key=lambda row: row[:3])]

    def place(self, building: Building) -> Optional[Tuple[float, float]]:
        """Longitude and latitude of a point in the building."""
        if building.footprint.isEmpty():
            return None
        wgs84 = QgsCoordinateReferenceSystem("EPSG:4326")
        transform = QgsCoordinateTransform(self.layer.crs(), wgs84, QgsProject.instance())
        point = transform.transform(building.footprint.pointOnSurface().asPoint())
        return round(point.x(), 7), round(point.y(), 7)


def is_result(layer: object) -> bool:
    """Whether a layer is the buildings of a result with its cameras beside it."""
    if not isinstance(layer, QgsVectorLayer) or not layer.isValid():
        return False
    path = file_of(layer)
    has_fields = all(layer.fields().indexFromName(name) >= 0 for name in FIELDS)
    return path is not None and has_fields and layer.geometryType() == 2 and not layer.name().startswith("buildings_lod") and (
        path.parent / "stages" / "survey.json"
    ).is_file()


def _building(feature: QgsFeature) -> Building:
    def number(name: str) -> Optional[float]:
        value = feature[name]
        return None if value is None or value == NULL else float(value)

    def words(name: str) -> List[str]:
        value = feature[name]
        return [] if value is None or value == NULL else [word for word in str(value).split("; ") if word]

    return Building(
        id=str(feature["id"]),
        status=str(feature["status"]),
        height_m=number("height_m"),
        sigma_m=number("height_sigma_m"),
        ground_z_m=number("ground_z_m"),
        base_z_m=number("base_z_m"),
        reasons=words("reasons"),
        views=words("views"),
        footprint=QgsGeometry(feature.geometry()),
    )


def _size_px(view: View, building: Building) -> float:
    """Area of the footprint on its ground in a photo, pixels; 0 where the photo does not show its middle."""
    if view.image is None or building.ground_z_m is None or building.footprint.isEmpty():
        return 0.0
    middle = building.footprint.pointOnSurface().asPoint()
    pixel = view.pixel((middle.x(), middle.y(), building.ground_z_m))
    if pixel is None or not view.contains(pixel):
        return 0.0
    pixels = [view.pixel((x, y, building.ground_z_m)) for x, y in building.rings[0]]
    if any(pixel is None for pixel in pixels):
        return 0.0
    pairs = zip(pixels, pixels[1:])
    return abs(sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in pairs)) / 2.0


def _is_whole(view: View, building: Building) -> bool:
    """Whether a photo has all corners of the block on its ground and at its roof."""
    levels = [building.ground_z_m] + ([building.ground_z_m + building.height_m] if building.height_m is not None else [])
    pixels = [view.pixel((x, y, z)) for z in levels for x, y in building.rings[0]]
    return all(pixel is not None and view.contains(pixel) for pixel in pixels)


def _issues(folder: Path) -> Dict[str, str]:
    """What `issues.json` says of single buildings."""
    try:
        issues = json.loads((folder / "issues.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    told: Dict[str, List[str]] = {}
    for issue in issues:
        subject = issue.get("subject", {})
        if subject.get("kind") == "building":
            hint = f" ({issue['hint']})" if issue.get("hint") else ""
            told.setdefault(str(subject.get("id")), []).append(issue.get("message", "") + hint)
    return {building: "\n".join(messages) for building, messages in told.items()}
