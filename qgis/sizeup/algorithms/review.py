"""Apply reviews: decisions of people into the result, without computing heights again."""

from pathlib import Path

from qgis.core import (
    QgsProcessingException,
    QgsProcessingOutputFile,
    QgsProcessingOutputNumber,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterFile,
)

from .. import results
from ..review.reviews import FILE_NAME
from .base import FAILED_ITEMS, SizeupAlgorithm


class ApplyReviews(SizeupAlgorithm):
    """Writes a result again with the decisions of `reviews.geojson`."""

    NAME = "applyreviews"

    def displayName(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr("Apply reviews")

    def shortHelpString(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr(
            "Writes a result again with the decisions that were made in the review panel.\n"
            "\n"
            "Buildings that were confirmed or corrected get the status “reviewed” and the reviewed height; buildings that "
            "were marked as wrong get the status “unknown”. All files of the folder are written again; heights are not "
            "computed again.\n"
            "\n"
            "The decisions stay in reviews.geojson in the folder, and count for later runs into it too."
        )

    def initAlgorithm(self, configuration=None) -> None:  # noqa: N802, the name is QGIS's
        self.addParameter(QgsProcessingParameterFile(
            "FOLDER", self.tr("Folder of the results"), behavior=QgsProcessingParameterFile.Folder,
        ))
        self.addParameter(QgsProcessingParameterBoolean(
            "LOAD", self.tr("Load the results, styled, as a group"), defaultValue=True,
        ))
        self.addOutput(QgsProcessingOutputFile("GEOPACKAGE", self.tr("GeoPackage")))
        self.addOutput(QgsProcessingOutputNumber("CODE", self.tr("Exit code")))

    def prepareAlgorithm(self, parameters, context, feedback) -> bool:  # noqa: N802, the name is QGIS's
        self.find_program()
        self._folder = Path(self.parameterAsFile(parameters, "FOLDER", context))
        for name in ("config.toml", FILE_NAME):
            if not (self._folder / name).is_file():
                raise QgsProcessingException(self.tr("{} is not there.").format(self._folder / name))
        results.refuse_edited(self._folder, context.project())
        self._load = self.parameterAsBool(parameters, "LOAD", context)
        self._file = None
        return True

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802, the name is QGIS's
        arguments = ["run", str(self._folder / "config.toml"), "--from", "output"]
        outcome = self.run_program([*arguments, "--set", f"reviews.path='{FILE_NAME}'"], feedback)
        if outcome is None:
            return {}
        if outcome.code == FAILED_ITEMS:
            feedback.pushInfo(self.tr("Some buildings have no height: see the layer qa_issues."))
        self._file = self._folder / "city.gpkg"
        return {"GEOPACKAGE": str(self._file), "CODE": outcome.code}

    def postProcessAlgorithm(self, context, feedback):  # noqa: N802, the name is QGIS's
        self.load(self._file, context)
        return {}
