"""What changed: two results against each other."""

from pathlib import Path

from qgis.core import (
    QgsProcessingOutputNumber,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterNumber,
)

from .. import results
from .base import SizeupAlgorithm

CHANGES = "changes.gpkg"
CITIES = "GeoPackage, CityJSON (*.gpkg *.json *.jsonl);;*.* (*.*)"


class CompareResults(SizeupAlgorithm):
    """Tells what changed between two flights."""

    NAME = "changes"

    def displayName(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr("What changed")

    def shortHelpString(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr(
            "Tells what changed between two results: new, gone, raised, lowered, footprint changed, same, or unsure.\n"
            "\n"
            "Buildings are matched by place, so their ids need not be the same: the new ones are kept, and the old ones stand "
            "beside them. A difference counts where both standard deviations do not explain it; where they are too wide to "
            "tell, the building is unsure. What is common to all buildings (a flight whose poses are a little off) is taken "
            "off and told.\n"
            "\n"
            "Each result is the city.gpkg of a run, or its CityJSON. The layer has a row per building, with the reason in words."
        )

    def initAlgorithm(self, configuration=None) -> None:  # noqa: N802, the name is QGIS's
        self.addParameter(QgsProcessingParameterFile("OLD", self.tr("Earlier result"), fileFilter=CITIES))
        self.addParameter(QgsProcessingParameterFile("NEW", self.tr("Later result"), fileFilter=CITIES))
        self.addParameter(QgsProcessingParameterNumber(
            "LEAST", self.tr("Least difference, metres"), type=QgsProcessingParameterNumber.Double,
            defaultValue=2.0, minValue=0.01,
        ))
        self.addParameter(QgsProcessingParameterBoolean(
            "LOAD", self.tr("Load the layer, styled"), defaultValue=True,
        ))
        for name, label in [("OLD_SIGMA", self.tr("Earlier sigma, metres")), ("NEW_SIGMA", self.tr("Later sigma, metres"))]:
            self.advanced(
                QgsProcessingParameterNumber(
                    name, label, type=QgsProcessingParameterNumber.Double, optional=True, minValue=0.0,
                ),
                self.tr("Standard deviation of heights whose file states none"),
            )
        self.advanced(
            QgsProcessingParameterBoolean("HEIGHTS_ONLY", self.tr("Compare heights above ground only"), defaultValue=False),
            self.tr("Levels of roofs are not compared"),
        )
        self.advanced(
            QgsProcessingParameterBoolean("KEEP_SHIFT", self.tr("Keep a common difference"), defaultValue=False),
            self.tr("What all buildings have in common counts as change, too"),
        )
        self.addParameter(QgsProcessingParameterFolderDestination("OUTPUT", self.tr("Folder of the comparison")))
        self.addOutput(QgsProcessingOutputNumber("N_CHANGED", self.tr("Number of buildings that have changed")))

    def prepareAlgorithm(self, parameters, context, feedback) -> bool:  # noqa: N802, the name is QGIS's
        self.find_program()
        self._load = self.parameterAsBool(parameters, "LOAD", context)
        self._is_done = False
        self._folder = self.folder(parameters, "OUTPUT", context)
        results.refuse_edited(self._folder, context.project())
        return True

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802, the name is QGIS's
        arguments = ["--json", "changes"]
        arguments += [self.parameterAsFile(parameters, name, context) for name in ("OLD", "NEW")]
        arguments += ["--output", str(self._folder), f"--least-m={self.parameterAsDouble(parameters, 'LEAST', context)}"]
        for name, option in [("OLD_SIGMA", "--old-sigma"), ("NEW_SIGMA", "--new-sigma")]:
            if parameters.get(name) not in (None, ""):
                arguments.append(f"{option}={self.parameterAsDouble(parameters, name, context)}")
        for name, option in [("HEIGHTS_ONLY", "--heights-only"), ("KEEP_SHIFT", "--keep-shift")]:
            if self.parameterAsBool(parameters, name, context):
                arguments.append(option)
        outcome = self.run_program(arguments, feedback)
        if outcome is None:
            return {}
        self._is_done = True
        summary = self.read_answer(outcome)
        for name, n in summary["counts"].items():
            feedback.pushInfo(f"{n:>8}  {name.replace('_', ' ')}")
        for note in summary["notes"]:
            feedback.pushInfo(note)
        changed = ("new", "gone", "raised", "lowered", "footprint_changed")
        n_changed = sum(summary["counts"].get(name, 0) for name in changed)
        return {"OUTPUT": str(self._folder), "N_CHANGED": n_changed}

    def postProcessAlgorithm(self, context, feedback):  # noqa: N802, the name is QGIS's
        if self._load and self._is_done and context.project() is not None:
            results.load(Path(self._folder) / CHANGES, results.CHANGES_LAYERS, self._folder, context.project())
        return {}
