"""Opens a GeoPackage in a real QGIS as a planner would, and reports what QGIS makes of it as JSON.

    /usr/bin/python3 tests/qgis/check.py town.gpkg map.png

The layers are opened without a click more: the style is the one that QGIS finds in the file.
"""

import json
import os
import sys

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtXml import QDomDocument
from qgis.core import (
    QgsApplication,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsReadWriteContext,
    QgsRenderContext,
    QgsVectorLayer,
)
from qgis._3d import Qgs3D


def extrusions(layer):
    """Expressions of the 3D symbols: where prisms stand and how far they reach."""
    document = QDomDocument()
    element = document.createElement("renderer-3d")
    renderer = layer.renderer3D()
    if renderer is None:
        return None
    renderer.writeXml(element, QgsReadWriteContext())
    document.appendChild(element)
    found = {}
    for name in ("height", "extrusionHeight"):
        options = document.elementsByTagName("Option")
        values = set()
        for i in range(options.count()):
            option = options.at(i).toElement()
            if option.attribute("name") == "expression" and option.parentNode().toElement().attribute("name") == name:
                values.add(option.attribute("value"))
        found[name] = sorted(values)
    data = document.elementsByTagName("data")
    found["clamping"] = sorted({data.at(i).toElement().attribute("alt-clamping") for i in range(data.count())})
    return found


def describe(layer):
    style = layer.styleManager().currentStyle()
    renderer = layer.renderer()
    legend = [item.label() for item in renderer.legendSymbolItems()]
    return {
        "valid": layer.isValid(),
        "crs": layer.crs().authid(),
        "features": layer.featureCount(),
        "renderer": renderer.type(),
        "legend": legend,
        "style": style,
        "fields": [field.name() for field in layer.fields()],
        "labels": layer.labelsEnabled(),
        "shown_from": layer.minimumScale() if layer.hasScaleBasedVisibility() else None,
        "symbols": sorted({s.symbolLayer(0).properties().get("name", "") for s in renderer.symbols(QgsRenderContext())}),
        "extrusion": extrusions(layer),
        "index": layer.hasSpatialIndex() == 2,
    }


def render(layers, path):
    settings = QgsMapSettings()
    settings.setLayers(layers)
    settings.setDestinationCrs(layers[0].crs())
    extent = layers[-1].extent()
    extent.scale(1.15)
    settings.setExtent(extent)
    settings.setOutputSize(QSize(1000, 800))
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    image = job.renderedImage()
    image.save(path)
    colours = set()
    for y in range(0, image.height(), 4):
        for x in range(0, image.width(), 4):
            colours.add(image.pixelColor(x, y).name())
    return sorted(colours)


def main():
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    application = QgsApplication([], False)
    application.initQgis()
    Qgs3D.initialize()
    names = ["cameras", "qa_issues", "buildings_lod1", "buildings_lod13", "buildings_lod2", "buildings"]
    layers = {name: QgsVectorLayer(f"{sys.argv[1]}|layername={name}", name, "ogr") for name in names}
    report = {name: describe(layer) for name, layer in layers.items()}
    report["colours"] = render([layers["cameras"], layers["qa_issues"], layers["buildings"]], sys.argv[2])
    json.dump(report, sys.stdout, indent=1)
    # Layers must go before the application they belong to.
    layers.clear()
    application.exitQgis()


if __name__ == "__main__":
    main()
