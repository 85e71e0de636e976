"""Export: a city in another format."""

from pathlib import Path

from qgis.core import (
    QgsProcessingException,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterNumber,
    QgsVectorLayer,
)

from .. import results
from ..layers import crs_text
from .base import SizeupAlgorithm

FORMATS = ("cityjson", "cityjsonseq", "geopackage", "flatgeobuf", "flatcitybuf", "geojson", "citygml", "citygml3", "obj", "stl", "dxf", "kml", "csv", "3dtiles")
ENDINGS = {
    "cityjson": ".city.json", "cityjsonseq": ".city.jsonl", "geopackage": ".gpkg", "flatgeobuf": ".fgb", "flatcitybuf": ".fcb", "geojson": ".geojson",
    "citygml": ".gml", "citygml3": ".gml", "obj": ".obj", "stl": ".stl", "dxf": ".dxf", "kml": ".kml", "csv": ".csv",
}
NAMES = ("sizeup", "3dbag")


class ExportCity(SizeupAlgorithm):
    """Writes a city in another format."""

    NAME = "export"

    def displayName(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr("Export")

    def shortHelpString(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr(
            "Writes a city in another format: CityJSON, CityJSONSeq, GeoPackage, FlatGeobuf, FlatCityBuf, GeoJSON, CityGML, OBJ, STL, "
            "DXF, KML, CSV, 3D Tiles.\n"
            "\n"
            "The input is a result of sizeup, or anybody's CityJSON with heights. 3D Tiles are a folder; they need to know "
            "how high the geoid is above the ellipsoid there, if the CRS does not say what heights count from.\n"
            "\n"
            "Cameras and issues are only in the files of a run: an export has the buildings with all their attributes."
        )

    def initAlgorithm(self, configuration=None) -> None:  # noqa: N802, the name is QGIS's
        self.addParameter(QgsProcessingParameterFile(
            "INPUT", self.tr("City"), fileFilter="CityJSON, GeoPackage, FlatGeobuf (*.json *.jsonl *.gpkg *.fgb);;*.* (*.*)",
        ))
        self.addParameter(QgsProcessingParameterEnum(
            "FORMAT", self.tr("Format"),
            [
                "CityJSON", "CityJSONSeq", "GeoPackage", "FlatGeobuf", "FlatCityBuf", "GeoJSON", "CityGML 2.0", "CityGML 3.0",
                self.tr("OBJ (modelling)"), self.tr("STL (printers)"), self.tr("DXF (CAD)"), self.tr("KML (globes)"), self.tr("CSV (tables)"),
                self.tr("3D Tiles (a folder)"),
            ], defaultValue=0,
        ))
        self.addParameter(QgsProcessingParameterCrs("CRS", self.tr("CRS, if the city states none"), optional=True))
        self.advanced(QgsProcessingParameterEnum(
            "NAMES", self.tr("CityJSON: names of attributes"), ["sizeup", "sizeup and 3DBAG"], defaultValue=0,
        ))
        self.advanced(QgsProcessingParameterNumber(
            "GEOID", self.tr("3D Tiles: geoid height, metres"),
            type=QgsProcessingParameterNumber.Double, optional=True,
        ), self.tr("Of the geoid, or the national zero, above the ellipsoid"))
        self.addParameter(QgsProcessingParameterBoolean("LOAD", self.tr("Load the file"), defaultValue=False))
        self.addParameter(QgsProcessingParameterFileDestination("OUTPUT", self.tr("File, or folder of 3D Tiles")))

    def prepareAlgorithm(self, parameters, context, feedback) -> bool:  # noqa: N802, the name is QGIS's
        self.find_program()
        self._load = self.parameterAsBool(parameters, "LOAD", context)
        self._is_done = False
        self._form = FORMATS[self.parameterAsEnum(parameters, "FORMAT", context)]
        # Asked for once: a temporary file is another each time.
        self._output = Path(with_ending(self.parameterAsFileOutput(parameters, "OUTPUT", context), self._form))
        if self._is_in_project(self._output, context):
            raise QgsProcessingException(self.tr("{} is open in this project: choose another name.").format(self._output))
        return True

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802, the name is QGIS's
        form, output = self._form, str(self._output)
        arguments = ["export", self.parameterAsFile(parameters, "INPUT", context), output, "--to", form]
        crs = self.parameterAsCrs(parameters, "CRS", context)
        if crs.isValid():
            arguments += ["--crs", crs_text(crs)]
        if form.startswith("cityjson"):
            arguments += ["--names", NAMES[self.parameterAsEnum(parameters, "NAMES", context)]]
        if form == "3dtiles" and parameters.get("GEOID") not in (None, ""):
            arguments.append(f"--geoid-height={self.parameterAsDouble(parameters, 'GEOID', context)}")
        if self.run_program(arguments, feedback) is None:
            return {}
        self._is_done = True
        return {"OUTPUT": output}

    def _is_in_project(self, output: Path, context) -> bool:
        project, path = context.project(), output.resolve()
        layers = results.layers_in(path.parent, project) if project is not None else []
        return any(results.file_of(layer).resolve() == path for layer in layers)

    def postProcessAlgorithm(self, context, feedback):  # noqa: N802, the name is QGIS's
        if self._load and self._is_done and context.project() is not None:
            if self._form == "geopackage":
                results.load(self._output, results.CITY_LAYERS, self._output.parent, context.project())
            elif self._form in ("flatgeobuf", "geojson"):
                context.project().addMapLayer(QgsVectorLayer(str(self._output), self._output.stem, "ogr"))
            else:
                feedback.pushInfo(self.tr("QGIS reads CityJSON and 3D Tiles through other plugins or newer versions."))
        return {}


def with_ending(path: str, form: str) -> str:
    """A path with the ending of its format; folders have none, nor has what Processing names by itself."""
    ending = ENDINGS.get(form)
    bare = path[: -len(".file")] if path.endswith(".file") else path
    if ending is None or bare.lower().endswith(ending.rsplit(".", 1)[-1]):
        return bare
    return bare + ending
