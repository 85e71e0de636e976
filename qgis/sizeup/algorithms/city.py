"""City from a folder of photos: what `sizeup init` and `sizeup run` do."""

from pathlib import Path
from typing import Any, Dict, List, Optional

from qgis.core import (
    QgsProcessing,
    QgsProcessingException,
    QgsProcessingOutputFile,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterField,
    QgsProcessingParameterFile,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterString,
)

from .. import results
from ..config import ConfigError, setting, settings_of, three_numbers
from ..layers import project_crs, raster_file
from ..plain import in_words_of_the_dialog
from ..review.reviews import FILE_NAME
from .base import INPUT, SETTINGS_FILE, SurveyAlgorithm


class CityFromFolder(SurveyAlgorithm):
    """Looks what is in a folder, says what is missing, and makes the city."""

    NAME = "city"

    def displayName(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr("City from a folder of photos")

    def shortHelpString(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr(
            "Makes a 3D city from a folder of photos and building footprints.\n"
            "\n"
            "Choose the folder of the photos, the footprints, and a folder for the results. The poses may be in the photos (DJI and "
            "other drones) or in files beside them: ODM, Metashape, Pix4D, COLMAP and others. The program finds the poses, the CRS, "
            "the heights and the ground. The log lists what it found, and what you should know of it.\n"
            "\n"
            "A terrain model (DTM) makes heights better. Put it into the folder of the photos, or choose it here. Without one, the "
            "program finds the ground in the photos.\n"
            "\n"
            "If something is missing, nothing is computed, and the message says what to add. “Only look at the folder” stops "
            "before anything is computed.\n"
            "\n"
            "The settings are written to input/sizeup.toml in the folder of the results. “Inspect survey” and “Estimate heights” "
            "can start from that file."
        )

    def initAlgorithm(self, configuration=None) -> None:  # noqa: N802, the name is QGIS's
        self.addParameter(QgsProcessingParameterFile(
            "FOLDER", self.tr("Folder of the photos"), behavior=QgsProcessingParameterFile.Folder,
        ))
        self.add(
            QgsProcessingParameterFeatureSource(
                "FOOTPRINTS", self.tr("Building footprints"), [QgsProcessing.TypeVectorPolygon], optional=True,
            ),
            self.tr("If empty: those in the folder"),
        )
        self.add(
            QgsProcessingParameterField(
                "FOOTPRINTS_ID", self.tr("Field of the buildings' ids"), parentLayerParameterName="FOOTPRINTS", optional=True,
            ),
            self.tr("If empty: the program chooses"),
        )
        self.add(
            QgsProcessingParameterBoolean("LOOK", self.tr("Only look at the folder"), defaultValue=False),
            self.tr("Computes nothing"),
        )
        self.advanced(QgsProcessingParameterRasterLayer("DTM", self.tr("Terrain model (DTM)"), optional=True))
        self.advanced(QgsProcessingParameterNumber(
            "GROUND", self.tr("Height of the ground, metres"), type=QgsProcessingParameterNumber.Double, optional=True,
        ))
        self.advanced(
            QgsProcessingParameterCrs("CRS", self.tr("CRS of the results"), optional=True), self.tr("Projected, in metres"),
        )
        self.advanced(
            QgsProcessingParameterString("OFFSET", self.tr("Offset of the poses: x, y, z"), optional=True),
            self.tr("Metres, which the program that wrote the poses took off them"),
        )
        self.add_further()
        self.addOutput(QgsProcessingOutputFile("SETTINGS", self.tr("Settings")))
        self.add_city()

    def prepareAlgorithm(self, parameters, context, feedback) -> bool:  # noqa: N802, the name is QGIS's
        self.find_program()
        self._photos = Path(self.parameterAsFile(parameters, "FOLDER", context))
        if not self._photos.is_dir():
            raise QgsProcessingException(self.tr("The folder of the photos {} is not there.").format(self._photos))
        self._folder = self.folder(parameters, "OUTPUT", context)
        # A file may be of a kind that QGIS reads in parts, such as OpenStreetMap's: the program chooses from it.
        named = parameters.get("FOOTPRINTS")
        self._named = Path(named) if isinstance(named, str) and Path(named).is_file() else None
        self._footprints = None if self._named else self.footprints(parameters, "FOOTPRINTS", context)
        self._id_field = (self.parameterAsFields(parameters, "FOOTPRINTS_ID", context) or [None])[0]
        self._options = self._stated(parameters, context)
        self._only_looks = self.parameterAsBool(parameters, "LOOK", context)
        try:
            self._more = settings_of(self.parameterAsString(parameters, "MORE", context))
        except ConfigError as error:
            raise QgsProcessingException(str(error)) from error
        results.refuse_edited(self._folder, context.project())
        self._load = self.parameterAsBool(parameters, "LOAD", context)
        self._file: Optional[Path] = None
        return True

    def _stated(self, parameters, context) -> List[str]:
        """What the user states himself, as arguments of `sizeup init`."""
        dtm = raster_file(self.parameterAsRasterLayer(parameters, "DTM", context))
        ground = self._number(parameters, "GROUND", context)
        if dtm is not None and ground is not None:
            raise QgsProcessingException(self.tr("Give a terrain model or a height of the ground, one of the two."))
        crs = self.parameterAsCrs(parameters, "CRS", context)
        try:
            offset = three_numbers(self.parameterAsString(parameters, "OFFSET", context))
        except ConfigError as error:
            raise QgsProcessingException(str(error)) from error
        stated = {
            "--dtm": dtm, "--ground": ground, "--crs": project_crs(crs) if crs.isValid() else None,
            "--offset": ",".join(map(repr, offset)) if offset else None,
        }
        return [f"{option}={value}" for option, value in stated.items() if value is not None]

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802, the name is QGIS's
        folder = self._folder
        config = folder / INPUT / SETTINGS_FILE
        config.parent.mkdir(parents=True, exist_ok=True)
        begun = self._begin(config, feedback)
        if begun is None:
            return {}
        answer = {"OUTPUT": str(folder), "SETTINGS": str(config)}
        if begun["missing"]:
            raise self.failure(self._missing(begun["missing"]), feedback)
        if self._only_looks:
            feedback.pushInfo(self.tr("Nothing is missing. The settings are in {}.").format(config))
            return answer
        outcome = self.run_program(["run", str(config), "--output", str(folder), *self._settings()], feedback)
        if outcome is None:
            return {}
        return {**answer, **self.city(outcome, feedback)}

    def _begin(self, config: Path, feedback) -> Optional[Dict[str, Any]]:
        """What the folder holds; None where the user stopped it. Says what was found, and each warning once."""
        footprints: List[str] = []
        if self._named is not None:
            footprints = ["--footprints", str(self._named)]
        elif self._footprints is not None:
            footprints = ["--footprints", self.layer_file(self._footprints, self._folder, feedback, alone=True).path]
        arguments = ["init", str(self._photos), "--output", str(config), "--force", "--json", *footprints, *self._options]
        outcome = self.run_program(arguments, feedback, is_silent=True)
        if outcome is None:
            return None
        begun = self.read_answer(outcome)
        for line in self._found(begun):
            feedback.pushInfo(line)
        for warning in begun["warnings"]:
            self.warn_once(in_words_of_the_dialog(warning), feedback)
        return begun

    def _found(self, begun: Dict[str, Any]) -> List[str]:
        """What was found, a line each."""
        flight, crs, layer = begun["flight"], begun["crs"], begun["footprints"]
        rows = [
            (self.tr("Photos"), self.tr("{} photos, {} with a usable pose: {} straight down, {} oblique").format(
                flight["n_photos"], flight["n_views"], flight["n_nadir"], flight["n_oblique"])),
            (self.tr("Poses"), f"{begun['poses']['path']}: {begun['poses']['why']}"),
            (self.tr("CRS"), f"{crs['definition']} ({crs['name']}): {crs['why']}" if crs else ""),
            (self.tr("Heights"), begun["heights"]),
            (self.tr("Footprints"), f"{layer['path']}: {layer['why']}" if layer else ""),
            (self.tr("Ground"), begun["ground"]),
        ]
        return [f"{label}: {in_words_of_the_dialog(text)}" for label, text in rows if text]

    def _missing(self, lacks: List[Dict[str, str]]) -> str:
        """What is missing, why, and how to get it."""
        first = self.tr("Missing: {}.").format(", ".join(lack["what"] for lack in lacks))
        lines = [f"{lack['what']}: {lack['why']}\n→ {lack['how']}" for lack in lacks]
        return "\n\n".join([first, *map(in_words_of_the_dialog, lines)])

    def _settings(self) -> List[str]:
        """Further settings as arguments of `sizeup run`."""
        own = []
        if self._id_field:
            own.append(setting("footprints.id_field", self._id_field))
        if (self._folder / FILE_NAME).is_file():
            own.append(setting("reviews.path", str(self._folder / FILE_NAME)))
        return [part for assignment in [*own, *self._more] for part in ("--set", assignment)]

    def postProcessAlgorithm(self, context, feedback):  # noqa: N802, the name is QGIS's
        self.load(self._file, context)
        return {}
