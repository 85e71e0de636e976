"""Draws the buildings of a GeoPackage, footprints or solids, in QGIS's 3D view, as they come styled; then looks at them from the south, from
afar, and says how wide and high each group of them is on the picture.

    xvfb-run -a /usr/bin/python3 tests/qgis/scene.py city.gpkg buildings_lod2 scene.png

QGIS 3.22 shows 3D to Python through the 3D map of a print layout only, and that one is set up from XML. It needs a
display with OpenGL: a virtual one with software rendering will do.
"""

import json
import os
import sys
from collections import Counter

os.environ.setdefault("LIBGL_ALWAYS_SOFTWARE", "1")

from qgis.PyQt.QtCore import QRectF
from qgis.PyQt.QtGui import QImage
from qgis.PyQt.QtXml import QDomDocument
from qgis.core import (
    QgsApplication,
    QgsLayout,
    QgsLayoutExporter,
    QgsProject,
    QgsReadWriteContext,
    QgsVectorLayer,
)
from qgis._3d import Qgs3D, QgsCameraPose, QgsLayoutItem3DMap, Qgs3DMapSettings
from qgis.core import QgsVector3D

# The scene of a 3D view: flat ground at the height of the lowest wall, two lights.
SCENE = """<qgis3d>
 <origin x="{x}" y="{y}" z="0"/>
 <camera field-of-view="45" camera-navigation-mode="terrain-based-navigation" projection-type="1" camera-movement-speed="5"/>
 <color background="207,224,238,255" selection="255,255,0,255"/>
 <point-lights/>
 <directional-lights>
  <directional-light x="0.4" y="-0.8" z="-0.5" color="255,255,255,255" intensity="0.4"/>
  <directional-light x="-0.7" y="-0.5" z="0.3" color="255,255,255,255" intensity="0.2"/>
 </directional-lights>
 <terrain exaggeration="1" texture-size="512" max-terrain-error="3" max-ground-error="1" shading-enabled="0"
          terrain-rendering-enabled="1" map-theme="" show-labels="0" elevation-offset="{ground}">
  <layers/>
  <generator type="flat"><extent xmin="{west}" ymin="{south}" xmax="{east}" ymax="{north}"/></generator>
 </terrain>
</qgis3d>"""


def main():
    if len(sys.argv) != 4:
        raise SystemExit(__doc__)
    application = QgsApplication([], True)
    application.initQgis()
    Qgs3D.initialize()
    project = QgsProject.instance()
    name, picture = sys.argv[2:]
    layer = QgsVectorLayer(f"{sys.argv[1]}|layername={name}", name, "ogr")
    project.setCrs(layer.crs())
    project.addMapLayer(layer)
    extent = layer.extent()
    ground = layer.minimumValue(layer.fields().indexOf("base_z_m"))
    roof = layer.maximumValue(layer.fields().indexOf("roof_z_m"))

    settings = Qgs3DMapSettings()
    text = SCENE.format(
        x=extent.center().x(), y=extent.center().y(), ground=ground, west=extent.xMinimum(), south=extent.yMinimum(),
        east=extent.xMaximum(), north=extent.yMaximum(),
    )
    document = QDomDocument()
    document.setContent(text)
    settings.readXml(document.documentElement(), QgsReadWriteContext())
    settings.setCrs(layer.crs())
    settings.setTransformContext(project.transformContext())
    settings.setPathResolver(project.pathResolver())
    settings.setMapThemeCollection(project.mapThemeCollection())
    settings.setLayers([layer])

    size = max(extent.width(), extent.height())
    result = draw(project, settings, picture, (ground + roof) / 2, 1.3 * size, 50, 30, 100)
    side = picture + ".side.png"
    result = result or draw(project, settings, side, (ground + roof) / 2, 8 * size, 90, 0, 250)
    json.dump({"result": result, "groups": groups(side), "colours": colours(picture)}, sys.stdout)
    sys.stdout.flush()
    # The scene's threads do not end in order here.
    os._exit(0)


def draw(project, settings, path, look_at, distance, pitch, heading, dpi):
    """Exports a page with one view; 0 if that worked."""
    layout = QgsLayout(project)
    layout.initializeDefaults()
    item = QgsLayoutItem3DMap(layout)
    item.attemptSetSceneRect(QRectF(0, 0, 290, 200))
    item.setMapSettings(Qgs3DMapSettings(settings))
    pose = QgsCameraPose()
    pose.setCenterPoint(QgsVector3D(0, look_at, 0))
    pose.setDistanceFromCenterPoint(distance)
    pose.setPitchAngle(pitch)
    pose.setHeadingAngle(heading)
    item.setCameraPose(pose)
    layout.addLayoutItem(item)
    options = QgsLayoutExporter.ImageExportSettings()
    options.dpi = dpi
    return int(QgsLayoutExporter(layout).exportToImage(path, options))


def colours(path):
    """The colours that cover most of a picture, most first."""
    image = QImage(path).convertToFormat(QImage.Format_RGB888)
    found = Counter(image.pixel(x, y) & 0xFFFFFF for y in range(0, image.height(), 2) for x in range(0, image.width(), 2))
    return [[value >> 16, value >> 8 & 255, value & 255] for value, _ in found.most_common(40)]


def groups(path):
    """Runs of columns with something on them: width, height and lowest row, pixels."""
    image = QImage(path).convertToFormat(QImage.Format_Grayscale8)
    bits, stride = image.constBits(), image.bytesPerLine()
    bits.setsize(stride * image.height())
    grey = bytes(bits)
    background = grey[5 * stride + 5]
    columns = []
    for x in range(image.width()):
        rows = [y for y, value in enumerate(grey[x::stride]) if value != background]
        columns.append((min(rows), max(rows)) if rows else None)
    found = []
    for x, column in enumerate(columns):
        if column is None:
            continue
        if found and found[-1]["end"] == x:
            group = found[-1]
            group["end"] = x + 1
            group["top"], group["bottom"] = min(group["top"], column[0]), max(group["bottom"], column[1])
        else:
            found.append({"start": x, "end": x + 1, "top": column[0], "bottom": column[1]})
    return [
        {"width": g["end"] - g["start"], "height": g["bottom"] + 1 - g["top"], "bottom": g["bottom"]} for g in found
    ]


if __name__ == "__main__":
    main()
