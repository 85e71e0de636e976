"""Inspect survey: are the poses right?"""

from qgis.core import (
    QgsProcessingOutputBoolean,
    QgsProcessingOutputFile,
    QgsProcessingOutputString,
    QgsProcessingParameterFolderDestination,
)

from .. import results
from .base import SurveyAlgorithm


class InspectSurvey(SurveyAlgorithm):
    """Looks the poses over before anything is computed from them, and loads cameras and image footprints."""

    NAME = "inspectsurvey"

    def displayName(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr("Inspect survey")

    def shortHelpString(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr(
            "Says whether the photos' poses look right, before anything is computed from them.\n"
            "\n"
            "Loads three layers: where the cameras are, where they look, and what part of the ground each photo shows. If "
            "these lie beside your footprints, the CRS, the offset or the reading of the angles is wrong; the report says "
            "which other reading looks better.\n"
            "\n"
            "Give the ground (a terrain model or one height) and the footprints too: both tell more of the poses.\n"
            "\n"
            "A table of poses needs to say what its angles mean, under “Further settings”: survey.csv.angles=opk and so on."
        )

    def initAlgorithm(self, configuration=None) -> None:  # noqa: N802, the name is QGIS's
        self.add_settings()
        self.add_survey()
        self.add_ground()
        self.add_footprints("FOOTPRINTS", self.tr("Building footprints"), optional=True)
        self.add_more()
        self.add_load()
        self.addParameter(QgsProcessingParameterFolderDestination("OUTPUT", self.tr("Folder of the report")))
        self.addOutput(QgsProcessingOutputBoolean("SOUND", self.tr("The poses look right")))
        self.addOutput(QgsProcessingOutputString("REPORT_TEXT", self.tr("Report")))
        self.addOutput(QgsProcessingOutputFile("REPORT", self.tr("Report")))
        self.addOutput(QgsProcessingOutputFile("PICTURE", self.tr("Map of the survey")))
        self.addOutput(QgsProcessingOutputFile("LAYERS", self.tr("GeoPackage of cameras and image footprints")))

    def prepareAlgorithm(self, parameters, context, feedback) -> bool:  # noqa: N802, the name is QGIS's
        self.find_program()
        self._folder = self.folder(parameters, "OUTPUT", context)
        self._run = self.survey_settings(parameters, context, str(self._folder))
        self._footprints = self.footprints(parameters, "FOOTPRINTS", context)
        results.refuse_edited(self._folder, context.project())
        self._load = self.parameterAsBool(parameters, "LOAD", context)
        self._layers = None
        return True

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802, the name is QGIS's
        folder = self._folder
        folder.mkdir(parents=True, exist_ok=True)
        if self._footprints is not None:
            self._run.footprints = self.layer_file(self._footprints, folder, feedback)
        config, *more = self.write_config(self._run, folder)
        picture, layers, report = folder / "survey.png", folder / "survey.gpkg", folder / "survey.txt"
        arguments = ["survey", "inspect", "--config", config, *more, "--picture", str(picture)]
        inspected = self.run_program(arguments, feedback)
        if inspected is None:
            return {}
        report.write_text(inspected.stdout, encoding="utf-8")
        feedback.pushInfo(inspected.stdout)
        is_sound = inspected.code == 0
        if not is_sound:
            feedback.pushWarning(self.tr("The poses look wrong: see the report above."))
        # Poses that look wrong are shown too: a look at them often tells what is wrong.
        arguments = ["survey", "convert", "--config", config, *more, "--set", "survey.accept_unsound=true"]
        if self.run_program([*arguments, "--to", "gpkg", "--output", str(layers)], feedback) is None:
            return {}
        self._layers = layers
        return {
            "OUTPUT": str(folder), "SOUND": is_sound, "REPORT_TEXT": inspected.stdout, "REPORT": str(report),
            "PICTURE": str(picture), "LAYERS": str(layers),
        }

    def postProcessAlgorithm(self, context, feedback):  # noqa: N802, the name is QGIS's
        self.load(self._layers, context, results.SURVEY_LAYERS)
        return {}
