"""The program's commands as functions: their keywords are the options of the command line, their answers Python's values."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from . import _native
from ._export import source_of
from ._program import Progress, as_json, call, options
from ._results import City, read

if TYPE_CHECKING:
    from typing import TypeAlias

    Source: TypeAlias = City | str | os.PathLike[str]


@dataclass(frozen=True)
class Missing:
    """Something without which a project cannot be run."""

    what: str
    """The missing part."""
    why: str
    """Why it is not there."""
    how: str
    """Way to get it."""


@dataclass(frozen=True)
class Project:
    """A project that :func:`init` began."""

    config: Path
    """The configuration that was written; :func:`run` takes it."""
    is_complete: bool
    """Whether it can be run as it is."""
    missing: tuple[Missing, ...]
    """Parts that have to be added before."""
    warnings: tuple[str, ...]
    """Remarks to read before a run; they are also warned of."""
    found: Mapping[str, Any] = field(repr=False)
    """What was found and chosen, and why: ``flight``, ``poses``, ``crs``, ``heights``, ``footprints``, ``terrain``, ``ground``, …."""


def init(
    folder: str | os.PathLike[str],
    *,
    output: str | os.PathLike[str] = "sizeup.toml",
    crs: str | None = None,
    offset: Sequence[float] | None = None,
    footprints: str | os.PathLike[str] | None = None,
    dtm: str | os.PathLike[str] | None = None,
    ground: float | None = None,
    force: bool = False,
) -> Project:
    """Begins a project from a folder of photos, as ``sizeup init`` does: finds poses, footprints and terrain, and writes a configuration.

    Warns of what should be read before a run. What is missing is in the answer and in the configuration.

    Args:
        folder: Folder with the photos, and with poses, footprints and terrain where there are such.
        output: Configuration to write; its paths count from its own folder.
        crs: The project's projected CRS in metres; by default that of the poses, the footprints or the terrain, else the UTM zone.
        offset: Easting, northing and height taken off the positions of poses in a local frame, metres.
        footprints: Building footprints, in place of what lies in the folder.
        dtm: Terrain model, in place of what lies in the folder.
        ground: One height of the ground, metres, counted from what the poses' heights count from.
        force: Replace the configuration where it exists.

    Raises:
        ConfigurationError: the configuration exists, or an argument means nothing.
        InputError: the folder has no photos with poses, or what was named cannot be used.
        RunError: the configuration cannot be written.
    """
    keywords = options(output=output, crs=crs, offset=offset, footprints=footprints, dtm=dtm, ground=ground, force=force)
    begun = call(["init", os.fspath(folder), *keywords])
    missing = tuple(Missing(**lack) for lack in begun.pop("missing"))
    warnings = tuple(begun.pop("warnings"))
    return Project(Path(begun.pop("config")), begun.pop("is_complete"), missing, warnings, begun)


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
    text = None if isinstance(config, (str, os.PathLike)) else _native.toml_of_json(as_json(config))
    words = ["-" if text is not None else os.fspath(config)]  # type: ignore[arg-type]
    for key, value in (settings or {}).items():
        words += ["--set", f"{key}={value if isinstance(value, str) else as_json(value)}"]
    summary = call(["run", *words, *options(output=output, threads=threads)], text, tell)
    return read(Path(summary["output"]))


def evaluate(
    result: Source,
    truth: Source,
    *,
    height_field: str | None = None,
    id_field: str | None = None,
    group_field: str | None = None,
    height_reference: Literal["eave", "mean", "ridge"] | None = None,
    lod: str | None = None,
    crs: str | None = None,
    truth_crs: str | None = None,
    same_vertical: bool = False,
    level_shift: float | None = None,
    heights_only: bool = False,
    pictures: str | os.PathLike[str] | None = None,
    roof_percentile: float | None = None,
    ground: float | None = None,
    min_score: float | None = None,
    min_area: float | None = None,
    roof_offset: bool = False,
) -> dict[str, Any]:
    """Compares a result with a reference and measures how far off it is, as ``sizeup evaluate`` does.

    Returns the measures by name, as ``sizeup evaluate --json`` prints them.

    Args:
        result: A city, the folder of a run, or a file: CityJSON, a vector layer with heights, OBJ, footprints in photos as COCO.
        truth: The reference: likewise, or a point cloud (LAS, LAZ, XYZ).
        height_field: Height attribute of the reference, metres above ground.
        id_field: Id attribute of the reference.
        group_field: Attribute of the reference that tells kinds of buildings apart; by default ``type``.
        height_reference: Which height of the reference's pitched roofs counts; by default ``mean``.
        lod: Level of detail of the reference's geometry; by default its highest.
        crs: CRS to compare in, projected and in metres; by default the result's.
        truth_crs: CRS of a reference that states none, or none with a vertical part.
        same_vertical: Levels of both count from the same zero, so that surfaces and volumes can be compared.
        level_shift: Metres to add to levels of the reference so that they count from the result's zero.
        heights_only: No footprints, surfaces and volumes.
        pictures: Folder to draw maps of the errors into.
        roof_percentile: Percentile of a point cloud's roof points that counts as the height, 0 to 100; by default 50.
        ground: Level of the ground of a point cloud without ground points, metres.
        min_score: For footprints in photos: leave out instances with a lower score, 0 to 1.
        min_area: For footprints in photos: smaller ones count for nothing, pixels².
        roof_offset: For footprints in photos: the result has roofs with an ``offset``, by which they are moved back.

    Raises:
        ConfigurationError: an argument means nothing.
        InputError: a file cannot be read, or nothing in the two can be compared.
    """
    keywords = options(
        height_field=height_field,
        id_field=id_field,
        group_field=group_field,
        height_reference=height_reference,
        lod=lod,
        crs=crs,
        truth_crs=truth_crs,
        same_vertical=same_vertical,
        level_shift=level_shift,
        heights_only=heights_only,
        pictures=pictures,
        roof_percentile=roof_percentile,
        ground=ground,
        min_score=min_score,
        min_area=min_area,
        roof_offset=roof_offset,
    )
    measures: dict[str, Any] = call(["evaluate", source_of(result), source_of(truth), *keywords])
    return measures


def changes(
    old: Source,
    new: Source,
    output: str | os.PathLike[str],
    *,
    least_m: float | None = None,
    sigmas: float | None = None,
    old_sigma: float | None = None,
    new_sigma: float | None = None,
    footprint_sigma: float | None = None,
    margin: float | None = None,
    area: Literal["photos", "footprints"] | None = None,
    keep_shift: bool = False,
    stated_sigmas: bool = False,
    heights_only: bool = False,
) -> dict[str, Any]:
    """Tells what changed between two results, as ``sizeup changes`` does.

    Returns the content of ``changes.json``: ``counts`` by class, and in ``changes`` every building of both results once.

    Args:
        old: The earlier result: a city, the folder of a run, CityJSON or a GeoPackage.
        new: The later result, likewise.
        output: Folder for changes.html, changes.gpkg, changes.json and changes.png.
        least_m: Least difference worth telling, up, down or sideways, metres.
        sigmas: Standard deviations that a difference must reach to be a change.
        old_sigma: Standard deviation of old heights that state none, metres; by default these are not compared.
        new_sigma: Standard deviation of new heights that state none, metres; by default these are not compared.
        footprint_sigma: Standard deviation of the corners of footprints that state none, metres.
        margin: How far beyond its footprints a result is taken to have looked, metres.
        area: Whether a result looked within the hull of its photos too, or around its footprints only; by default ``photos``.
        keep_shift: Leave a shift that is common to all buildings in the differences.
        stated_sigmas: Take sigmas as stated, also where differences scatter more than these say.
        heights_only: Compare heights above ground only, not levels of roofs.

    Raises:
        ConfigurationError: an argument means nothing.
        InputError: a result cannot be read, or the two cannot be compared.
        RunError: a file cannot be written.
    """
    keywords = options(
        output=output,
        least_m=least_m,
        sigmas=sigmas,
        old_sigma=old_sigma,
        new_sigma=new_sigma,
        footprint_sigma=footprint_sigma,
        margin=margin,
        area=area,
        keep_shift=keep_shift,
        stated_sigmas=stated_sigmas,
        heights_only=heights_only,
    )
    call(["changes", source_of(old), source_of(new), *keywords])
    report: dict[str, Any] = json.loads(Path(output, "changes.json").read_text(encoding="utf-8"))
    return report
