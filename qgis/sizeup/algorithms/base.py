"""What all algorithms share: parameters by name, the program with progress and cancel, results in the project."""

import json
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Set

from qgis.core import (
    QgsProcessing,
    QgsProcessingAlgorithm,
    QgsProcessingException,
    QgsProcessingOutputFile,
    QgsProcessingOutputNumber,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterField,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterString,
)
from qgis.PyQt.QtGui import QIcon

from .. import program, results, settings
from ..config import ConfigError, Layer, RunSettings, three_numbers
from ..layers import Footprints, crs_text, project_crs, raster_file
from ..plain import in_words_of_the_dialog
from ..progress import Progress
from ..words import Speaks

ICON = Path(__file__).parents[1] / "icon.svg"
# Where the settings and copies of layers lie, within the folder of results.
INPUT = "input"
SETTINGS_FILE = "sizeup.toml"
# Finished, but some items of the input have no result.
FAILED_ITEMS = 5
# The program's mark of results that were being replaced when it ended.
UNFINISHED = "UNFINISHED.txt"


class SizeupAlgorithm(QgsProcessingAlgorithm, Speaks):
    """An algorithm that runs the program."""

    # Words of the toolbox, without `tr`: each class has its own.
    NAME = ""

    def __init__(self) -> None:
        super().__init__()
        self._program = ""
        self._folder: Optional[Path] = None
        self._warned: Set[str] = set()

    def createInstance(self):  # noqa: N802, the name is QGIS's
        return type(self)()

    def name(self) -> str:
        return self.NAME

    def icon(self) -> QIcon:
        return QIcon(str(ICON))

    def svgIconPath(self) -> str:  # noqa: N802, the name is QGIS's
        return str(ICON)

    def shortDescription(self) -> str:  # noqa: N802, the name is QGIS's
        return self.shortHelpString().strip().split("\n")[0]

    def canExecute(self):  # noqa: N802, the name is QGIS's
        """The dialog says at once where the program is missing."""
        try:
            program.find(settings.ProcessingConfig.getSetting(settings.PROGRAM) or "")
        except program.ProgramError as error:
            return False, str(error)
        return True, ""

    def add(self, parameter: QgsProcessingParameterDefinition, help: str = "") -> None:
        """Adds a parameter. Its label fits into the dialog as QGIS opens it; what does not is help, which the mouse shows."""
        parameter.setHelp(help)
        self.addParameter(parameter)

    def advanced(self, parameter: QgsProcessingParameterDefinition, help: str = "") -> None:
        """Adds a parameter that is folded away."""
        parameter.setFlags(parameter.flags() | QgsProcessingParameterDefinition.FlagAdvanced)
        self.add(parameter, help)

    def profiles(self) -> List[str]:
        """Profiles of depth networks that the program knows; none where it is not there."""
        try:
            return program.profiles(program.find(settings.ProcessingConfig.getSetting(settings.PROGRAM) or ""))
        except program.ProgramError:
            return []

    def find_program(self) -> None:
        """Looks for the program before anything else is done."""
        try:
            self._program = settings.sizeup()
        except program.ProgramError as error:
            raise QgsProcessingException(str(error)) from error

    def warn_once(self, text: str, feedback) -> None:
        """Shows a warning, unless it was shown before."""
        if text not in self._warned:
            self._warned.add(text)
            feedback.pushWarning(text)

    def run_program(self, arguments: Sequence[str], feedback, is_silent: bool = False) -> Optional[program.Outcome]:
        """Runs the program; None where the user stopped it. Raises QgsProcessingException where it failed.

        Of a silent one only the progress is shown: its answer has the messages too.
        """
        feedback.pushCommandInfo(" ".join(["sizeup", *(_quoted(argument) for argument in arguments)]))
        progress = Progress()

        def tell(event: program.Event) -> None:
            begun = progress.take(event)
            feedback.setProgress(progress.percent)
            if begun:
                feedback.setProgressText(self.line(begun, progress))
            if event["event"] == "message" and not is_silent:
                self._show(event, feedback)

        try:
            return program.run(self._program, arguments, tell, feedback.isCanceled)
        except program.Cancelled:
            feedback.pushInfo(self.tr("Stopped. Nothing is loaded; every file is whole, or absent."))
            if self._folder is not None and (self._folder / UNFINISHED).is_file():
                feedback.pushWarning(self.tr("The files in {} are of two runs: run it again.").format(self._folder))
            return None
        except program.ProgramError as error:
            raise self.failure(in_words_of_the_dialog(str(error)), feedback) from error

    def failure(self, text: str, feedback) -> QgsProcessingException:
        """The exception of a failure. QGIS shows its text up to three times: it has the first line, the log has all, once."""
        first, _, rest = text.partition("\n")
        if rest:
            feedback.reportError(text)
        return QgsProcessingException(first)

    def _show(self, event: program.Event, feedback) -> None:
        """Shows a message of the program."""
        level, text = event.get("level", "info"), in_words_of_the_dialog(event["message"])
        if level == "error":
            feedback.reportError(text)
        elif level == "warning":
            self.warn_once(text, feedback)
        else:
            feedback.pushInfo(text)

    def read_answer(self, outcome: program.Outcome) -> Dict[str, Any]:
        """The JSON that the program printed. Raises QgsProcessingException where it is none."""
        try:
            return json.loads(outcome.stdout)
        except ValueError as error:
            raise QgsProcessingException(self.tr("The program's answer cannot be read: {}").format(error)) from error

    def line(self, begun: str, progress: Progress) -> str:
        """A line of the log: what begins, or how far the run is, and the time left where that is known."""
        words = {
            "survey": self.tr("Reading the survey"), "footprints": self.tr("Laying footprints on the ground"),
            "heights": self.tr("Finding heights"), "output": self.tr("Writing the results"),
            "ground": self.tr("Looking for the ground in the photos"), "photos": self.tr("Looking at the photos"),
            "align": self.tr("Aligning the poses with the photos"), "quarter": f"{progress.percent:.0f} %",
        }.get(begun, begun)
        left_s = progress.left_s()
        if left_s is None:
            return words
        left = self.tr("{} min").format(round(left_s / 60)) if left_s >= 90 else self.tr("{} s").format(round(left_s))
        return self.tr("{} (about {} left)").format(words, left)

    def load(self, file: Optional[Path], context, layers=results.CITY_LAYERS) -> None:
        """Loads the layers of a file, a city's by default, where one was made and the user wants them."""
        if self._load and file is not None and context.project() is not None:
            loaded = results.load(file, layers, self._folder, context.project())
            if not loaded:
                raise QgsProcessingException(self.tr("Cannot load {}").format(file))
            results.zoom_to(next((layer for layer in loaded if layer.name() == "buildings"), loaded[0]))

    def folder(self, parameters, name: str, context) -> Path:
        """A folder to write to. Asked for once: a temporary one is another each time."""
        return Path(self.parameterAsFileOutput(parameters, name, context))


class SurveyAlgorithm(SizeupAlgorithm):
    """An algorithm about photos with poses on their ground."""

    def __init__(self) -> None:
        super().__init__()
        self._run: Optional[RunSettings] = None
        self._footprints: Optional[Footprints] = None
        self._settings_file: Optional[str] = None

    def add_settings(self) -> None:
        """Parameter: settings that have all of the others."""
        self.add(
            QgsProcessingParameterFile("SETTINGS", self.tr("Settings"), extension="toml", optional=True),
            self.tr("Written by “City from a folder of photos”. Then nothing else is needed."),
        )

    def add_survey(self) -> None:
        """Parameters: the poses, the photos, the CRS."""
        self.add(
            QgsProcessingParameterFile(
                "SURVEY_FOLDER", self.tr("Poses: folder"), behavior=QgsProcessingParameterFile.Folder, optional=True,
            ),
            self.tr("The folder of a model (COLMAP, OpenSfM), or of photos with poses"),
        )
        self.add(
            QgsProcessingParameterFile("SURVEY", self.tr("… or poses: file"), optional=True),
            self.tr("XML, CSV, JSON and others"),
        )
        self.addParameter(QgsProcessingParameterFile(
            "IMAGES", self.tr("Folder of the photos"), behavior=QgsProcessingParameterFile.Folder, optional=True,
        ))
        self.add(QgsProcessingParameterCrs(
            "CRS", self.tr("CRS of the results"), defaultValue="ProjectCrs", optional=True,
        ), self.tr("Projected, in metres"))

    def add_ground(self) -> None:
        """Parameters: a terrain model, or one height."""
        self.addParameter(QgsProcessingParameterRasterLayer("DTM", self.tr("Terrain model (DTM)"), optional=True))
        self.addParameter(QgsProcessingParameterNumber(
            "GROUND", self.tr("… or one ground height, metres"),
            type=QgsProcessingParameterNumber.Double, optional=True,
        ))

    def add_footprints(self, name: str, label: str, optional: bool = False) -> None:
        """Parameters: a layer of footprints and its field of ids."""
        self.addParameter(QgsProcessingParameterFeatureSource(
            name, label, [QgsProcessing.TypeVectorPolygon], optional=optional,
        ))
        self.addParameter(QgsProcessingParameterField(
            f"{name}_ID", self.tr("Field of the buildings' ids"), parentLayerParameterName=name, optional=True,
        ))

    def add_more(self) -> None:
        """Parameters that few people need."""
        self.advanced(QgsProcessingParameterCrs("POSE_CRS", self.tr("CRS of the poses, if another"), optional=True))
        self.advanced(
            QgsProcessingParameterString("OFFSET", self.tr("Offset of the poses: x, y, z"), optional=True),
            self.tr("Metres, added to the poses"),
        )
        self.add_further()

    def add_further(self) -> None:
        """Parameter: settings that have none of their own."""
        self.advanced(
            QgsProcessingParameterString("MORE", self.tr("Further settings"), multiLine=True, optional=True),
            self.tr("One per line, as in heights.max_m=60"),
        )

    def add_load(self) -> None:
        """Parameter: whether results go into the project."""
        self.addParameter(QgsProcessingParameterBoolean(
            "LOAD", self.tr("Load the results, styled, as a group"), defaultValue=True,
        ))

    def add_city(self) -> None:
        """Parameters and outputs of a run: a folder with a city, which may be loaded."""
        self.add_load()
        self.addParameter(QgsProcessingParameterFolderDestination("OUTPUT", self.tr("Folder of the results")))
        self.addOutput(QgsProcessingOutputFile("GEOPACKAGE", self.tr("GeoPackage")))
        self.addOutput(QgsProcessingOutputFile("CITYJSON", self.tr("CityJSON")))
        self.addOutput(QgsProcessingOutputFile("REPORT", self.tr("Report")))
        self.addOutput(QgsProcessingOutputNumber("CODE", self.tr("Exit code")))

    def city(self, outcome: program.Outcome, feedback) -> Dict[str, Any]:
        """The files of a run that came to its end. Remembers the one to load."""
        if outcome.code == FAILED_ITEMS:
            feedback.pushWarning(
                self.tr("Some buildings or photos have no result: see the layer qa_issues, or issues.json in the folder.")
            )
        self._file = self._folder / "city.gpkg"
        return {
            "GEOPACKAGE": str(self._file), "CITYJSON": str(self._folder / "city.city.json"),
            "REPORT": str(self._folder / "report.html"), "CODE": outcome.code,
        }

    def survey_settings(self, parameters, context, output: str) -> RunSettings:
        """What the parameters say of photos, poses, ground and CRS. Raises QgsProcessingException."""
        kept = self.parameterAsFile(parameters, "SETTINGS", context)
        if kept and not Path(kept).is_file():
            raise QgsProcessingException(self.tr("The settings {} are not there.").format(kept))
        self._settings_file = kept or None
        if kept:
            return RunSettings(crs="", output=output, survey=kept, more=[self.parameterAsString(parameters, "MORE", context)])
        file = self.parameterAsFile(parameters, "SURVEY", context)
        folder = self.parameterAsFile(parameters, "SURVEY_FOLDER", context)
        if bool(file) == bool(folder):
            raise QgsProcessingException(self.tr("Give the survey as a file or as a folder, one of the two."))
        if not Path(file or folder).exists():
            raise QgsProcessingException(self.tr("The survey {} is not there.").format(file or folder))
        pose_crs = self.parameterAsCrs(parameters, "POSE_CRS", context)
        try:
            return RunSettings(
                crs=project_crs(self.parameterAsCrs(parameters, "CRS", context)),
                output=output,
                survey=file or folder,
                images=self.parameterAsFile(parameters, "IMAGES", context) or None,
                pose_crs=crs_text(pose_crs) if pose_crs.isValid() else None,
                offset=three_numbers(self.parameterAsString(parameters, "OFFSET", context)),
                dtm=raster_file(self.parameterAsRasterLayer(parameters, "DTM", context)),
                ground_m=self._number(parameters, "GROUND", context),
                more=[self.parameterAsString(parameters, "MORE", context)],
            )
        except ConfigError as error:
            raise QgsProcessingException(str(error)) from error

    def footprints(self, parameters, name: str, context) -> Optional[Footprints]:
        """The layer of a parameter, looked at on the main thread; None where none is chosen."""
        if parameters.get(name) in (None, ""):
            return None
        source = self.parameterAsSource(parameters, name, context)
        if source is None:
            raise QgsProcessingException(self.invalidSourceError(parameters, name))
        fields = self.parameterAsFields(parameters, f"{name}_ID", context)
        return Footprints(
            self.parameterAsVectorLayer(parameters, name, context), source, parameters[name],
            fields[0] if fields else None, context.transformContext(),
        )

    def layer_file(
        self, footprints: Footprints, folder: Path, feedback, name: str = "footprints.gpkg", alone: bool = False,
    ) -> Layer:
        """The file of a layer, exported into the results where it is none, or where it shall be alone in its file and is not."""
        if alone:
            footprints.part_from_others()
        if footprints.is_exported:
            feedback.pushInfo(self.tr("The footprints are exported for the program: they are no plain file, or a part of one."))
        return footprints.file(folder / INPUT / name)

    def write_config(self, run: RunSettings, folder: Path) -> List[str]:
        """Writes `sizeup.toml`, unless there are settings; the arguments that name it and the further settings."""
        try:
            if self._settings_file is not None:
                return [self._settings_file, *(part for more in run.assignments() for part in ("--set", more))]
            text, assignments = run.to_toml(), run.assignments()
        except ConfigError as error:
            raise QgsProcessingException(str(error)) from error
        path = folder / INPUT / SETTINGS_FILE
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        more = [part for assignment in assignments for part in ("--set", assignment)]
        return [str(path), *more]

    def _number(self, parameters: Dict[str, Any], name: str, context) -> Optional[float]:
        if parameters.get(name) in (None, ""):
            return None
        return self.parameterAsDouble(parameters, name, context)


def _quoted(argument: str) -> str:
    return f"'{argument}'" if " " in argument else argument
