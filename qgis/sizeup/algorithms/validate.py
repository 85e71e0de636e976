"""Validate: form and solids of a CityJSON file."""

import json
from pathlib import Path
from typing import Any, Dict, Optional

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsFeature,
    QgsFeatureSink,
    QgsField,
    QgsFields,
    QgsGeometry,
    QgsPoint,
    QgsProcessing,
    QgsProcessingOutputBoolean,
    QgsProcessingOutputNumber,
    QgsProcessingParameterFeatureSink,
    QgsProcessingParameterFile,
    QgsWkbTypes,
)
from qgis.PyQt.QtCore import QVariant

from .base import SizeupAlgorithm

COLUMNS = ("code", "object", "lod", "solid", "shell", "surface", "message")
# Faults of form that are printed; the others are in the count.
N_PRINTED = 50


class ValidateCity(SizeupAlgorithm):
    """Checks anybody's CityJSON and puts the faults on the map."""

    NAME = "validate"

    def displayName(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr("Validate")

    def shortHelpString(self) -> str:  # noqa: N802, the name is QGIS's
        return self.tr(
            "Checks a CityJSON file: its form by the schema, and its solids with the codes of val3dity (ISO 19107).\n"
            "\n"
            "Each fault of a solid becomes a point at its place, with code, object and surface. CityJSON 1.0, 1.1, 2.0 and "
            "CityJSONSeq (.jsonl) of any program will do."
        )

    def initAlgorithm(self, configuration=None) -> None:  # noqa: N802, the name is QGIS's
        self.addParameter(QgsProcessingParameterFile(
            "INPUT", self.tr("CityJSON file"), fileFilter="CityJSON (*.json *.jsonl);;*.* (*.*)",
        ))
        self.addParameter(QgsProcessingParameterFeatureSink(
            "FAULTS", self.tr("Faults"), QgsProcessing.TypeVectorPoint, optional=True,
        ))
        self.addOutput(QgsProcessingOutputBoolean("VALID", self.tr("No fault was found")))
        self.addOutput(QgsProcessingOutputNumber("N_FAULTS", self.tr("Number of faults")))
        self.addOutput(QgsProcessingOutputNumber("N_GEOMETRIES", self.tr("Number of geometries")))

    def prepareAlgorithm(self, parameters, context, feedback) -> bool:  # noqa: N802, the name is QGIS's
        self.find_program()
        return True

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802, the name is QGIS's
        path = self.parameterAsFile(parameters, "INPUT", context)
        outcome = self.run_program(["--json", "check", path, "--all"], feedback)
        if outcome is None:
            return {}
        found = self.read_answer(outcome)
        self._tell(found, feedback)
        fields = QgsFields()
        for name in COLUMNS:
            fields.append(QgsField(name, QVariant.String))
        crs = crs_of(Path(path))
        if not crs.isValid() and found["faults"]:
            feedback.pushWarning(self.tr("The file states no CRS: the faults have none either."))
        sink, layer = self.parameterAsSink(parameters, "FAULTS", context, fields, QgsWkbTypes.PointZ, crs)
        for fault in found["faults"] if sink is not None else []:
            sink.addFeature(_feature(fault, fields), QgsFeatureSink.FastInsert)
        n_faults = len(found["faults"]) + len(_form(found).get("errors", []))
        answer = {"VALID": n_faults == 0, "N_FAULTS": n_faults, "N_GEOMETRIES": found.get("n_geometries", 0)}
        if layer is not None:
            answer["FAULTS"] = layer
        return answer

    def _tell(self, found: Dict[str, Any], feedback) -> None:
        n, n_valid = found.get("n_geometries", 0), found.get("n_valid", 0)
        feedback.pushInfo(self.tr("{} of {} geometries are valid").format(n_valid, n))
        errors = _form(found).get("errors", [])
        for error in errors[:N_PRINTED]:
            feedback.reportError(f"{error.get('check', '')}: {error.get('message', '')}")
        if len(errors) > N_PRINTED:
            feedback.reportError(self.tr("… and {} more faults of form").format(len(errors) - N_PRINTED))


def _form(found: Dict[str, Any]) -> Dict[str, Any]:
    return found.get("form") or {}


def _feature(fault: Dict[str, Any], fields: QgsFields) -> QgsFeature:
    feature = QgsFeature(fields)
    feature.setAttributes([_text(fault.get(name)) for name in COLUMNS])
    if fault.get("position"):
        feature.setGeometry(QgsGeometry(QgsPoint(*fault["position"])))
    return feature


def _text(value: Any) -> Optional[str]:
    return None if value is None else str(value)


def crs_of(path: Path) -> QgsCoordinateReferenceSystem:
    """The CRS that a CityJSON file or sequence states; an invalid one where it states none."""
    with path.open(encoding="utf-8") as file:
        try:
            head = json.loads(file.readline() if path.suffix == ".jsonl" else file.read())
            reference = head.get("metadata", {}).get("referenceSystem", "")
        except (ValueError, AttributeError):
            return QgsCoordinateReferenceSystem()
    parts = reference.replace("urn:ogc:def:crs:", "").replace("::", "/").strip("/").split("/")
    return QgsCoordinateReferenceSystem(f"EPSG:{parts[-1]}") if parts[-1].isdigit() else QgsCoordinateReferenceSystem()
