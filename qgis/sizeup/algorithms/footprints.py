"""Footprints from photos, where there is no layer."""

from qgis.core import (
    QgsProcessingException,
    QgsProcessingOutputFile,
    QgsProcessingOutputNumber,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterString,
)

from .. import results
from ..config import MASK_KINDS, FootprintNetwork, Masks
from .base import FAILED_ITEMS, SurveyAlgorithm

SOURCES = ("masks", "network")
PROFILES = ("semantic", "sam3")


class FindFootprints(SurveyAlgorithm):
    """Finds footprints in masks of the nadir photos, or with a segmentation network."""

    NAME = "footprints"

    def displayName(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr("Footprints from photos")

    def shortHelpString(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr(
            "Finds building footprints in the nadir photos, lays them on the ground and makes one footprint per building.\n"
            "\n"
            "It takes masks that another tool has made (one image per photo, or one COCO file), or runs a segmentation "
            "network (ONNX). In the masks' path {stem} stands for the photo's name without extension: masks/{stem}.png\n"
            "\n"
            "Kinds of masks: “instance”, every building has its own number; “semantic”, building or not; “probability”; "
            "“coco”, one JSON file. Row houses stay apart only where masks tell them apart.\n"
            "\n"
            "With a cadastre, ids and attributes of known buildings are kept, and what is new or gone is marked.\n"
            "\n"
            "The result is footprints.gpkg, styled by how sure each footprint is, and pictures of the photos with the footprints "
            "drawn over them."
        )

    def initAlgorithm(self, configuration=None) -> None:  # noqa: N802, the name is QGIS's
        self.add_survey()
        self.add_ground()
        self.addParameter(QgsProcessingParameterEnum(
            "SOURCE", self.tr("Footprints come from"),
            [self.tr("masks of the nadir photos"), self.tr("a segmentation network")], defaultValue=0,
        ))
        self.add(
            QgsProcessingParameterString("MASKS", self.tr("Masks: path with {stem}"), optional=True),
            self.tr("{stem} stands for the name of the photo, as in masks/{stem}.png"),
        )
        self.addParameter(QgsProcessingParameterEnum(
            "MASK_KIND", self.tr("Masks: kind"), list(MASK_KINDS), defaultValue=0,
        ))
        self.addParameter(QgsProcessingParameterFile(
            "MODEL", self.tr("Network: ONNX file"), extension="onnx", optional=True,
        ))
        self.addParameter(QgsProcessingParameterEnum(
            "PROFILE", self.tr("Network: profile"), list(PROFILES), defaultValue=0,
        ))
        self.add_footprints("CADASTRE", self.tr("Cadastre whose ids are kept"), optional=True)
        self.add_more()
        self.add_load()
        self.addParameter(QgsProcessingParameterFolderDestination("OUTPUT", self.tr("Folder of the results")))
        self.addOutput(QgsProcessingOutputFile("FOOTPRINTS", self.tr("GeoPackage of the footprints")))
        self.addOutput(QgsProcessingOutputNumber("CODE", self.tr("Exit code")))

    def prepareAlgorithm(self, parameters, context, feedback) -> bool:  # noqa: N802, the name is QGIS's
        self.find_program()
        self._folder = self.folder(parameters, "OUTPUT", context)
        self._run = self.survey_settings(parameters, context, str(self._folder))
        self._footprints = self.footprints(parameters, "CADASTRE", context)
        if SOURCES[self.parameterAsEnum(parameters, "SOURCE", context)] == "masks":
            if not self.parameterAsString(parameters, "MASKS", context):
                raise QgsProcessingException(self.tr("Say where the masks are, as in masks/{stem}.png."))
        elif not self.parameterAsFile(parameters, "MODEL", context):
            raise QgsProcessingException(self.tr("Name the network's ONNX file."))
        if self._run.dtm is None and self._run.ground_m is None:
            raise QgsProcessingException(self.tr("Give a terrain model, or one height of the ground."))
        results.refuse_edited(self._folder, context.project())
        self._load = self.parameterAsBool(parameters, "LOAD", context)
        self._file = None
        return True

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802, the name is QGIS's
        folder = self._folder
        folder.mkdir(parents=True, exist_ok=True)
        cadastre = None
        if self._footprints is not None:
            cadastre = self.layer_file(self._footprints, folder, feedback, "cadastre.gpkg")
        if SOURCES[self.parameterAsEnum(parameters, "SOURCE", context)] == "masks":
            kind = MASK_KINDS[self.parameterAsEnum(parameters, "MASK_KIND", context)]
            self._run.footprints = Masks(self.parameterAsString(parameters, "MASKS", context), kind, cadastre)
        else:
            profile = PROFILES[self.parameterAsEnum(parameters, "PROFILE", context)]
            self._run.footprints = FootprintNetwork(self.parameterAsFile(parameters, "MODEL", context), profile, cadastre)
        outcome = self.run_program(["footprints", *self.write_config(self._run, folder)], feedback)
        if outcome is None:
            return {}
        if outcome.code == FAILED_ITEMS:
            feedback.pushWarning(self.tr("Some photos could not be used: see issues.json in the folder."))
        self._file = folder / "footprints.gpkg"
        return {"OUTPUT": str(folder), "FOOTPRINTS": str(self._file), "CODE": outcome.code}

    def postProcessAlgorithm(self, context, feedback):  # noqa: N802, the name is QGIS's
        self.load(self._file, context, results.FOOTPRINT_LAYERS)
        return {}
