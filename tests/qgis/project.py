"""Opens a project in a real QGIS as a planner would, and reports what QGIS makes of it as JSON.

    /usr/bin/python3 tests/qgis/project.py city.qgs map.png
"""

import json
import os
import sys

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from qgis.core import (
    QgsApplication,
    QgsLayoutExporter,
    QgsLayoutItem,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsProject,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize
from qgis._3d import Qgs3D

from check import describe


def describe_raster(layer):
    voids = [[r.min(), r.max()] for r in layer.dataProvider().userNoDataValues(1)]
    return {"valid": layer.isValid(), "crs": layer.crs().authid(), "renderer": layer.renderer().type(), "voids": voids}


def describe_layout(layout, picture):
    """The named items of a page, and the page as a picture."""
    items = {item.id(): item for item in layout.items() if isinstance(item, QgsLayoutItem) and item.id()}
    root = items["legend"].model().rootGroup()
    titles = {node.name(): node.customProperty("legend/title-label", "") for node in root.findLayers()}
    settings = QgsLayoutExporter.ImageExportSettings()
    settings.dpi = 90
    QgsLayoutExporter(layout).exportToImage(picture + ".page.png", settings)
    return {"items": sorted(items), "sources": items["sources"].text(), "place": items["place"].text(),
            "scale": round(items["map"].scale()),
            "titles": titles}


def main():
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    application = QgsApplication([], False)
    application.initQgis()
    Qgs3D.initialize()
    project = QgsProject.instance()
    report = {"read": project.read(sys.argv[1]), "crs": project.crs().authid(), "title": project.title()}
    drawn = [layer for layer in project.layerTreeRoot().checkedLayers()]
    report["drawn"] = [layer.name() for layer in drawn]
    report["groups"] = [group.name() for group in project.layerTreeRoot().findGroups()]
    report["layers"] = {
        layer.name(): describe(layer) if isinstance(layer, QgsVectorLayer) else describe_raster(layer)
        for layer in project.mapLayers().values()
    }
    report["layouts"] = {layout.name(): describe_layout(layout, sys.argv[2]) for layout in project.layoutManager().layouts()}
    settings = QgsMapSettings()
    settings.setLayers(drawn)
    settings.setDestinationCrs(project.crs())
    extent = project.viewSettings().defaultViewExtent()
    if extent.isNull():
        extent = project.mapLayersByName("buildings")[0].extent()
    extent.scale(1.1)
    settings.setExtent(extent)
    settings.setOutputSize(QSize(1000, 800))
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    job.renderedImage().save(sys.argv[2])
    labels = job.takeLabelingResults()
    marks = [mark.geometry().asPoint() for mark in project.mapLayersByName("qa_issues")[0].getFeatures() if mark.hasGeometry()]
    report["labels"] = len(labels.labelsWithinRect(extent))
    report["labels_on_marks"] = sum(bool(labels.labelsAtPosition(mark)) for mark in marks)
    json.dump(report, sys.stdout, indent=1)
    del drawn
    project.clear()
    application.exitQgis()


if __name__ == "__main__":
    main()
