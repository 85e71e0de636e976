"""A city in another format: a function, and a method of cities."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ._program import call, options

if TYPE_CHECKING:
    from ._results import City


def export(
    city: City | str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    to: str | None = None,
    crs: str | None = None,
    layer: str | None = None,
    project: bool = False,
    names: Literal["sizeup", "3dbag"] | None = None,
    extension_url: str | None = None,
    heights: Literal["crs", "ellipsoidal"] | None = None,
    geoid_height: float | None = None,
    quantise: bool = False,
) -> Path:
    """Writes a city in another format, as ``sizeup export`` does, and returns the path that was written.

    Args:
        city: A city (the file that it was read from), the folder of a run, or a file: CityJSON, CityJSONSeq, GeoPackage, FlatGeobuf.
        output: File to write, or the folder of 3D Tiles.
        to: Format, such as ``citygml`` or ``3dtiles``; by default the ending of the output says it.
        crs: CRS of an input that states none.
        layer: GeoJSON: another layer of a GeoPackage than the buildings, such as ``qa_issues`` or ``cameras``.
        project: GeoPackage: also write a QGIS project beside it.
        names: CityJSON: ``3dbag`` adds the names of the Dutch 3DBAG to ours.
        extension_url: CityJSON: where ``sizeup.ext.json`` is published, to declare our attributes as that extension.
        heights: 3D Tiles: what heights are; by default what the CRS says.
        geoid_height: 3D Tiles: height of the geoid above the ellipsoid for the whole city, metres.
        quantise: 3D Tiles: vertices in 16-bit steps, half the size.

    Raises:
        ConfigurationError: the format is unknown, or an argument means nothing.
        InputError: the city cannot be read or written in that format.
        RunError: the file cannot be written.
    """
    keywords = options(
        to=to,
        crs=crs,
        layer=layer,
        project=project,
        names=names,
        extension_url=extension_url,
        heights=heights,
        geoid_height=geoid_height,
        quantise=quantise,
    )
    call(["export", source_of(city), os.fspath(output), *keywords])
    return Path(output)


def source_of(city: Any) -> str:
    """Path of a city's file, or the path that is given."""
    return str(os.fspath(getattr(city, "path", city)))
