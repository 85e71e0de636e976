"""Estimate heights: the whole run."""

from qgis.core import (
    QgsProcessingException,
    QgsProcessingParameterEnum,
    QgsProcessingParameterString,
)

from .. import results
from ..config import PRIOR_KINDS, PRIOR_SOURCES, ConfigError, Prior, setting
from ..review.reviews import FILE_NAME
from .base import SurveyAlgorithm


class EstimateHeights(SurveyAlgorithm):
    """Finds one height per building: a LOD1 city."""

    NAME = "heights"

    def displayName(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr("Estimate heights")

    def shortHelpString(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr(
            "Finds one height per building footprint in oblique photos, and writes a LOD1 city: GeoPackage, CityJSON, report.\n"
            "\n"
            "It takes photos with known poses, building footprints, and the ground: a terrain model, not a surface model, or one "
            "height where it is flat. Footprints may be in any CRS; results are in the CRS that is chosen here, projected and in "
            "metres. Of a layer with a filter or a selection, what is filtered or selected is taken.\n"
            "\n"
            "Depth of the photos comes from:\n"
            "- “automatic”: a network where one is named and in place, else stereo\n"
            "- “stereo”: the photos matched with each other\n"
            "- “files”: one depth map per photo, priors/{stem}.npy, from any network\n"
            "- “network”: an ONNX file, or the name of one that `sizeup model get` has put in place\n"
            "\n"
            "The layers are loaded styled: buildings by height, doubtful ones hatched, issues as points, cameras. Open "
            "report.html in the folder for photos and evidence, and look at doubtful buildings with Plugins > sizeup > Review "
            "buildings. Decisions that lie in the folder (reviews.geojson) are applied when it is run again.\n"
            "\n"
            "Where it is stopped, nothing is loaded, and every file in the folder is whole, of this run or the one before."
        )

    def initAlgorithm(self, configuration=None) -> None:  # noqa: N802, the name is QGIS's
        self.add_settings()
        self.add_survey()
        self.add_footprints("FOOTPRINTS", self.tr("Building footprints"), optional=True)
        self.add_ground()
        self.addParameter(QgsProcessingParameterEnum(
            "PRIOR_SOURCE", self.tr("Depth comes from"),
            [self.tr("automatic"), self.tr("stereo"), self.tr("files"), self.tr("a network")], defaultValue=0,
        ))
        self.add(
            QgsProcessingParameterString("PRIOR_FILES", self.tr("Files: path with {stem}"), optional=True),
            self.tr("{stem} stands for the name of the photo, as in priors/{stem}.npy"),
        )
        self.addParameter(QgsProcessingParameterEnum(
            "PRIOR_KIND", self.tr("Files: numbers are"),
            [self.tr("depth (higher is farther)"), self.tr("inverse depth (higher is nearer)")], defaultValue=0,
        ))
        self.addParameter(QgsProcessingParameterString(
            "MODEL", self.tr("Network: ONNX file or name"), optional=True,
        ))
        self.add(
            QgsProcessingParameterEnum(
                "PROFILE", self.tr("Network: profile"), self.profiles(), optional=True, usesStaticStrings=True,
            ),
            self.tr("If empty: by the name of the network"),
        )
        self.advanced(
            QgsProcessingParameterString("VERTICAL", self.tr("Vertical reference"), optional=True),
            self.tr("What heights count from, in words: DHHN2016, NAP, …"),
        )
        self.add_more()
        self.add_city()

    def prepareAlgorithm(self, parameters, context, feedback) -> bool:  # noqa: N802, the name is QGIS's
        self.find_program()
        self._folder = self.folder(parameters, "OUTPUT", context)
        self._run = self.survey_settings(parameters, context, str(self._folder))
        self._load = self.parameterAsBool(parameters, "LOAD", context)
        self._file = None
        results.refuse_edited(self._folder, context.project())
        if self._settings_file is not None:
            return True
        self._run.prior = self._prior(parameters, context)
        self._run.vertical_reference = self.parameterAsString(parameters, "VERTICAL", context) or None
        self._footprints = self.footprints(parameters, "FOOTPRINTS", context)
        if self._footprints is None:
            raise QgsProcessingException(self.tr("Choose a layer of building footprints."))
        if self._run.dtm is None and self._run.ground_m is None:
            raise QgsProcessingException(self.tr(
                "Give a terrain model, or one height of the ground. “City from a folder of photos” finds the ground itself."
            ))
        if (self._folder / FILE_NAME).is_file():
            self._run.reviews = str(self._folder / FILE_NAME)
        try:
            self._run.tables()
        except ConfigError as error:
            raise QgsProcessingException(str(error)) from error
        return True

    def _prior(self, parameters, context) -> Prior:
        return Prior(
            source=PRIOR_SOURCES[self.parameterAsEnum(parameters, "PRIOR_SOURCE", context)],
            path=self.parameterAsString(parameters, "PRIOR_FILES", context) or None,
            kind=PRIOR_KINDS[self.parameterAsEnum(parameters, "PRIOR_KIND", context)],
            model=self.parameterAsString(parameters, "MODEL", context) or None,
            profile=self.parameterAsEnumString(parameters, "PROFILE", context) or None,
        )

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802, the name is QGIS's
        folder = self._folder
        folder.mkdir(parents=True, exist_ok=True)
        if self._footprints is not None:
            self._run.footprints = self.layer_file(self._footprints, folder, feedback)
        arguments = ["run", *self.write_config(self._run, folder), "--output", str(folder)]
        if self._settings_file is not None and (folder / FILE_NAME).is_file():
            arguments += ["--set", setting("reviews.path", str(folder / FILE_NAME))]
        outcome = self.run_program(arguments, feedback)
        if outcome is None:
            return {}
        return {"OUTPUT": str(folder), **self.city(outcome, feedback)}

    def postProcessAlgorithm(self, context, feedback):  # noqa: N802, the name is QGIS's
        self.load(self._file, context)
        return {}
