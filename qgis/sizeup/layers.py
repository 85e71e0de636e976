"""Layers of QGIS as files that the program can read."""

from pathlib import Path
from typing import Optional

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsFeatureSink,
    QgsProcessingException,
    QgsProcessingFeatureSource,
    QgsProcessingFeatureSourceDefinition,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsUnitTypes,
    QgsVectorFileWriter,
    QgsVectorLayer,
)

from .config import Layer
from .words import Speaks


class Footprints(Speaks):
    """A vector layer that the program shall read: as the file it is, or else exported.

    Made on the main thread, where layers may be looked at; `file` may be called on any.
    """

    def __init__(
        self,
        layer: Optional[QgsVectorLayer],
        source: QgsProcessingFeatureSource,
        definition: object,
        id_field: Optional[str],
        transforms,
    ) -> None:
        self._source = source
        self._id_field = id_field
        self._transforms = transforms
        self._own_file: Optional[Layer] = None
        name = layer.name() if layer is not None else source.sourceName()
        if layer is not None and layer.isEditable() and layer.isModified():
            raise QgsProcessingException(
                self.tr("The layer “{}” has unsaved edits: save or discard them first.").format(name)
            )
        if not source.sourceCrs().isValid():
            raise QgsProcessingException(
                self.tr("The layer “{}” has no CRS: set it in Layer Properties > Source.").format(name)
            )
        if layer is not None and not _is_part(definition):
            self._own_file = _own_file(layer, id_field)

    @property
    def is_exported(self) -> bool:
        """Whether the program reads a copy: of what is selected, filtered, in a database or in memory."""
        return self._own_file is None

    def part_from_others(self) -> None:
        """Makes `file` write a copy where the layer's own file has other layers, too."""
        if self._own_file is not None and len(QgsProviderRegistry.instance().querySublayers(self._own_file.path)) > 1:
            self._own_file = None

    def file(self, copy: Path) -> Layer:
        """The layer's own file, or `copy`, a GeoPackage that is written now."""
        if self._own_file is not None:
            return self._own_file
        copy.parent.mkdir(parents=True, exist_ok=True)
        options = QgsVectorFileWriter.SaveVectorOptions()
        options.driverName, options.layerName, options.fileEncoding = "GPKG", "footprints", "UTF-8"
        source = self._source
        writer = QgsVectorFileWriter.create(
            str(copy), source.fields(), source.wkbType(), source.sourceCrs(), self._transforms, options
        )
        if writer.hasError() != QgsVectorFileWriter.NoError:
            raise QgsProcessingException(self.tr("Cannot write {}: {}").format(copy, writer.errorMessage()))
        n = 0
        for feature in source.getFeatures():
            # The feature numbers of a selection are no ids of the copy.
            feature.setId(n)
            if not writer.addFeature(feature, QgsFeatureSink.FastInsert):
                raise QgsProcessingException(self.tr("Cannot write {}: {}").format(copy, writer.errorMessage()))
            n += 1
        del writer
        if n == 0:
            raise QgsProcessingException(self.tr("The layer “{}” has no features to read.").format(source.sourceName()))
        return Layer(str(copy), "footprints", self._id_field)


def _is_part(definition: object) -> bool:
    """Whether a parameter's value stands for some of the features only."""
    if not isinstance(definition, QgsProcessingFeatureSourceDefinition):
        return False
    return bool(
        definition.selectedFeaturesOnly or definition.featureLimit >= 0 or getattr(definition, "filterExpression", "")
    )


def _own_file(layer: QgsVectorLayer, id_field: Optional[str]) -> Optional[Layer]:
    """The file that a layer is, where the program would read the same from it."""
    provider = layer.dataProvider()
    if provider.name() != "ogr" or layer.subsetString() or provider.crs() != layer.crs():
        return None
    # Joined and computed fields are not in the file.
    if id_field and provider.fields().indexFromName(id_field) < 0:
        return None
    parts = QgsProviderRegistry.instance().decodeUri("ogr", layer.source())
    path = parts.get("path", "")
    if not path or not Path(path).is_file() or parts.get("vsiPrefix") or parts.get("layerId", -1) not in (-1, None, 0):
        return None
    return Layer(path, parts.get("layerName") or None, id_field)


def raster_file(layer: Optional[QgsRasterLayer]) -> Optional[str]:
    """The file of a terrain model; None for no layer. Raises QgsProcessingException where it is no plain file."""
    if layer is None:
        return None
    path = layer.source()
    if layer.providerType() == "gdal" and Path(path).is_file():
        return path
    raise QgsProcessingException(
        Speaks.tr(
            "The terrain model “{}” is not a file: save it with Layer > Save As… as a GeoTIFF first, and choose that."
        ).format(layer.name())
    )


def project_crs(crs: QgsCoordinateReferenceSystem) -> str:
    """A CRS as the program takes it. Raises QgsProcessingException where results cannot be in it."""
    if not crs.isValid():
        raise QgsProcessingException(Speaks.tr("No CRS: choose a projected one in metres, such as EPSG:25832."))
    if crs.isGeographic():
        raise QgsProcessingException(
            Speaks.tr(
                "{} is geographic: its unit is a degree. Choose a projected CRS in metres, such as the UTM zone of the "
                "place; the layers themselves may stay as they are."
            ).format(crs.userFriendlyIdentifier())
        )
    if crs.mapUnits() != QgsUnitTypes.DistanceMeters:
        unit = QgsUnitTypes.toString(crs.mapUnits())
        raise QgsProcessingException(
            Speaks.tr("The unit of {} is {}: choose a projected CRS in metres.").format(
                crs.userFriendlyIdentifier(), unit
            )
        )
    return crs_text(crs)


def crs_text(crs: QgsCoordinateReferenceSystem) -> str:
    """A CRS as a code where it has one, else as WKT."""
    code = crs.authid()
    if code and not code.upper().startswith("USER:"):
        return code
    return crs.toWkt(QgsCoordinateReferenceSystem.WKT_PREFERRED)
