"""Results of the program in the project: styled layers in a group named after their folder."""

from pathlib import Path
from typing import List, Optional, Sequence

from qgis.core import (
    QgsLayerTreeGroup,
    QgsLayerTreeLayer,
    QgsMapLayer,
    QgsProcessingException,
    QgsProject,
    QgsProviderRegistry,
    QgsRectangle,
    QgsVectorLayer,
)

from .words import Speaks

# How much of the map is shown around a result, in its own sizes.
MAP_MARGIN = 1.1
# Layers of a city's GeoPackage from the top to the bottom, and whether they are drawn at once.
CITY_LAYERS = (
    ("qa_issues", True),
    ("footprints_moved", True),
    ("cameras", False),
    ("buildings", True),
    ("buildings_lod1", False),
    ("buildings_lod13", False),
    ("buildings_lod2", False),
)
FOOTPRINT_LAYERS = (("vanished", True), ("footprints", True), ("candidates", False))
CHANGES_LAYERS = (("changes", True),)
SURVEY_LAYERS = (("camera_points", True), ("view_axes", True), ("image_footprints", True))


def file_of(layer: QgsMapLayer) -> Optional[Path]:
    """The file that a vector layer is read from; None for others."""
    if not isinstance(layer, QgsVectorLayer) or layer.dataProvider() is None or layer.providerType() != "ogr":
        return None
    path = QgsProviderRegistry.instance().decodeUri("ogr", layer.source()).get("path")
    return Path(path) if path else None


def layers_in(folder: Path, project: QgsProject) -> List[QgsVectorLayer]:
    """The project's layers whose files lie in a folder."""
    folder = folder.resolve()
    files = ((layer, file_of(layer)) for layer in project.mapLayers().values())
    return [layer for layer, path in files if path is not None and path.resolve().parent == folder]


def refuse_edited(folder: Path, project: Optional[QgsProject]) -> None:
    """Raises QgsProcessingException where a result that is about to be replaced is being edited."""
    edited = [layer for layer in layers_in(folder, project) if layer.isEditable()] if project is not None else []
    if edited:
        raise QgsProcessingException(
            Speaks.tr("The layer “{}” of {} is being edited: end that first, the folder's files are to be replaced.")
            .format(edited[0].name(), folder)
        )


def load(file: Path, names: Sequence, folder: Path, project: QgsProject) -> List[QgsVectorLayer]:
    """Loads layers of a file into the group of its folder, styled as the file says; earlier ones of it are replaced."""
    group = _group(folder, project)
    earlier = [layer.id() for layer in layers_in(file.parent, project) if file_of(layer).resolve() == file.resolve()]
    project.removeMapLayers(earlier)
    loaded = []
    for name, is_drawn in names:
        layer = QgsVectorLayer(f"{file}|layername={name}", name, "ogr")
        if not layer.isValid():
            continue
        project.addMapLayer(layer, False)
        # Set before it is in the tree: the panel takes what is there then.
        node = QgsLayerTreeLayer(layer)
        node.setItemVisibilityChecked(is_drawn)
        node.setExpanded(name in ("buildings", "footprints", "changes"))
        group.addChildNode(node)
        loaded.append(layer)
    return loaded


def zoom_to(layer: QgsVectorLayer) -> None:
    """Shows a layer in the map window, where there is one."""
    from qgis.utils import iface

    if iface is None or layer.extent().isEmpty():
        return
    canvas = iface.mapCanvas()
    extent = QgsRectangle(layer.extent())
    extent.scale(MAP_MARGIN)
    canvas.setExtent(canvas.mapSettings().layerExtentToOutputExtent(layer, extent))
    canvas.refresh()


def _group(folder: Path, project: QgsProject) -> QgsLayerTreeGroup:
    """The group of a folder, which remembers it: names alone may be those of several."""
    root = project.layerTreeRoot()
    key, place = "sizeup/folder", str(folder.resolve())
    for group in root.findGroups():
        if group.customProperty(key) == place:
            return group
    group = root.insertGroup(0, folder.name or place)
    group.setCustomProperty(key, place)
    return group
