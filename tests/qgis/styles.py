"""Makes the default styles of the GeoPackage's layers in a real QGIS and exports them as QML.

    /usr/bin/python3 tests/qgis/styles.py crates/results/src/output/geopackage/styles crates/footprints/src/styles crates/results/src/changes/styles

The first folder is for the layers of `city.gpkg`, the second for those of `footprints.gpkg`, the third for that of `changes.gpkg`.
Classes and colours are viridis, even in lightness and readable for colour-blind people; `crates/results/src/output/height_classes.json`
has them, for other pictures of the city too. A building without a height is hatched in grey, never missing; a doubtful one
is hatched over its colour, one with a height from a fallback dotted, and one that a person has reviewed edged in green. In 3D, footprints stand on `base_z_m` (absolute, not
relative to a terrain) and reach `roof_z_m`; doubtful ones have orange edges.
"""

import json
import os
import re
import sys
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
# Attributes of XML elements in the same order in every run.
os.environ.setdefault("QT_HASH_SEED", "0")

from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtGui import QColor, QFont
from qgis.PyQt.QtXml import QDomDocument
from qgis.core import (
    QgsApplication,
    QgsFillSymbol,
    QgsLabelObstacleSettings,
    QgsLayoutItemLabel,
    QgsLayoutItemLegend,
    QgsLayoutItemMap,
    QgsLayoutItemPicture,
    QgsLayoutItemScaleBar,
    QgsLayoutPoint,
    QgsLayoutSize,
    QgsLegendStyle,
    QgsMapLayer,
    QgsMarkerSymbol,
    QgsPalLayerSettings,
    QgsPrintLayout,
    QgsProject,
    QgsProperty,
    QgsPropertyCollection,
    QgsReadWriteContext,
    QgsRectangle,
    QgsRuleBasedRenderer,
    QgsScaleBarSettings,
    QgsSymbolLayer,
    QgsTextBufferSettings,
    QgsTextFormat,
    QgsUnitTypes,
    QgsVectorLayer,
    QgsVectorLayerSimpleLabeling,
)
from qgis._3d import Qgs3D, Qgs3DTypes, QgsPhongMaterialSettings, QgsPolygon3DSymbol, QgsRuleBased3DRenderer

ROOT = Path(__file__).resolve().parents[2]
# Upper bound of each class in metres (None: open) and its viridis colour.
CLASSES = [(entry["below_m"], entry["colour"]) for entry in json.loads((ROOT / "crates/results/src/output/height_classes.json").read_text())]
# What deserves a second look.
ALERT = "213,94,0,255"
ATTRIBUTES = "field=id:string&field=height_m:double&field=base_z_m:double&field=roof_z_m:double&field=status:string"


def classes():
    """(label, filter, colour) of each height class."""
    low = None
    for high, colour in CLASSES:
        bounds = [f'"height_m" >= {low}'] if low is not None else ['"height_m" IS NOT NULL']
        if high is not None:
            bounds.append(f'"height_m" < {high}')
        if low is None:
            label = f"below {high} m"
        elif high is None:
            label = f"{low} m and more"
        else:
            label = f"{low} to {high} m"
        yield label, " AND ".join(bounds), colour
        low = high


def height_renderer():
    """Height classes, and a hatch for buildings whose height is not known."""
    root = QgsRuleBasedRenderer.Rule(None)
    pen = {"outline_color": "45,45,52,255", "outline_width": "0.15"}
    for label, expression, colour in classes():
        symbol = QgsFillSymbol.createSimple({"color": colour, **pen})
        root.appendChild(QgsRuleBasedRenderer.Rule(symbol, filterExp=expression, label=label))
    unknown = QgsFillSymbol.createSimple({"color": "#8c8c92", "style": "b_diagonal", **pen})
    root.appendChild(QgsRuleBasedRenderer.Rule(unknown, label="height not known", elseRule=True))
    # Over the colour of the class: a second pass, so that no neighbour's filling covers it.
    for label, status, hatch in [
        ("doubtful: look at it", "doubtful", {"style": "f_diagonal", "color": ALERT, "outline_color": ALERT, "outline_width": "0.4"}),
        ("reviewed by a person", "reviewed", {"style": "no", "outline_color": "0,158,115,255", "outline_width": "0.6"}),
        ("height from a fallback", "fallback", {"style": "dense6", "color": "white", "outline_color": "45,45,52,255", "outline_width": "0.3"}),
    ]:
        symbol = QgsFillSymbol.createSimple(hatch)
        symbol.symbolLayer(0).setRenderingPass(1)
        root.appendChild(QgsRuleBasedRenderer.Rule(symbol, filterExp=f"\"status\" = '{status}'", label=label))
    renderer = QgsRuleBasedRenderer(root)
    renderer.setUsingSymbolLevels(True)
    return renderer


def height_labels():
    """The height in metres where there is room: labels never cover each other, and doubtful ones ask."""
    label = QgsPalLayerSettings()
    label.isExpression = True
    label.fieldName = "format_number(\"height_m\", 1) || if(\"status\" = 'doubtful', ' ?', '')"
    label.placement = QgsPalLayerSettings.Horizontal
    label.fitInPolygonOnly = True
    label.scaleVisibility = True
    label.minimumScale, label.maximumScale = 4000, 1
    text = QgsTextFormat()
    text.setSize(7)
    text.setColor(QColor(25, 25, 30))
    halo = QgsTextBufferSettings()
    halo.setEnabled(True)
    halo.setSize(0.7)
    halo.setColor(QColor("white"))
    text.setBuffer(halo)
    label.setFormat(text)
    return QgsVectorLayerSimpleLabeling(label)


def solid(colour, edges):
    """Faces where they are, in one colour."""
    # QGIS draws (ambient + light) * diffuse. A flat roof takes 0.43 of the project's two lights, measured in QGIS 3.22, so that it
    # has the colour of the legend here.
    material = QgsPhongMaterialSettings()
    material.setAmbient(QColor("white"))
    material.setDiffuse(QColor(*(round(value / 1.43) for value in QColor(colour).getRgb()[:3])))
    material.setSpecular(QColor("black"))
    symbol = QgsPolygon3DSymbol()
    symbol.setAltitudeClamping(Qgs3DTypes.AltClampAbsolute)
    symbol.setCullingMode(Qgs3DTypes.NoCulling)
    symbol.setRenderedFacade(3)
    symbol.setEdgesEnabled(True)
    symbol.setEdgeColor(edges)
    symbol.setEdgeWidth(1.0 if edges == QColor(45, 45, 52) else 2.5)
    symbol.setMaterial(material)
    return symbol


def prism(colour, edges):
    """Walls and roof between base_z_m and roof_z_m in one colour."""
    symbol = solid(colour, edges)
    levels = QgsPropertyCollection()
    levels.setProperty(QgsPolygon3DSymbol.PropertyHeight, QgsProperty.fromExpression('"base_z_m"'))
    levels.setProperty(
        QgsPolygon3DSymbol.PropertyExtrusionHeight, QgsProperty.fromExpression('"roof_z_m" - "base_z_m"')
    )
    symbol.setDataDefinedProperties(levels)
    return symbol


def in_3d(symbol):
    """The classes of the map as solids; without a height there are none."""
    root = QgsRuleBased3DRenderer.Rule(None)
    sure, doubtful = "coalesce(\"status\", '') <> 'doubtful'", "\"status\" = 'doubtful'"
    for label, expression, colour in classes():
        root.appendChild(QgsRuleBased3DRenderer.Rule(symbol(colour, QColor(45, 45, 52)), f"{expression} AND {sure}", label))
    for label, expression, colour in classes():
        rule = QgsRuleBased3DRenderer.Rule(symbol(colour, QColor(213, 94, 0)), f"{expression} AND {doubtful}", f"{label}, doubtful")
        root.appendChild(rule)
    return QgsRuleBased3DRenderer(root)


def buildings():
    layer = QgsVectorLayer(f"Polygon?crs=EPSG:25832&{ATTRIBUTES}", "buildings", "memory")
    layer.setRenderer(height_renderer())
    layer.setRenderer3D(in_3d(prism))
    layer.setLabeling(height_labels())
    layer.setLabelsEnabled(True)
    layer.setDisplayExpression("\"id\" || ': ' || coalesce(format_number(\"height_m\", 1) || ' m', 'height not known')")
    layer.setMapTipTemplate(
        "<b>[% \"id\" %]</b><br>[% coalesce(format_number(\"height_m\", 1) || ' m', 'height not known') %]"
        "<br>[% \"status\" %]"
    )
    return layer


def blocks():
    layer = QgsVectorLayer(f"MultiPolygonZ?crs=EPSG:25832&{ATTRIBUTES}", "buildings_lod1", "memory")
    layer.setRenderer(height_renderer())
    return layer


def roofed():
    layer = QgsVectorLayer(f"MultiPolygonZ?crs=EPSG:25832&{ATTRIBUTES}", "buildings_lod2", "memory")
    layer.setRenderer(height_renderer())
    layer.setRenderer3D(in_3d(solid))
    return layer


def cameras():
    layer = QgsVectorLayer(
        "PointZ?crs=EPSG:25832&field=image:string&field=kind:string&field=yaw_deg:double", "cameras", "memory"
    )
    root = QgsRuleBasedRenderer.Rule(None)
    arrow = QgsMarkerSymbol.createSimple({"name": "arrow", "color": "38,38,46,255", "size": "3.4", "outline_color": "white"})
    arrow.symbolLayer(0).setDataDefinedProperty(QgsSymbolLayer.PropertyAngle, QgsProperty.fromField("yaw_deg"))
    dot = QgsMarkerSymbol.createSimple({"name": "circle", "color": "white", "size": "2", "outline_color": "38,38,46,255"})
    root.appendChild(QgsRuleBasedRenderer.Rule(arrow, filterExp="\"kind\" = 'oblique'", label="oblique photo"))
    root.appendChild(QgsRuleBasedRenderer.Rule(dot, filterExp="\"kind\" = 'nadir'", label="nadir photo"))
    up = QgsMarkerSymbol.createSimple({"name": "triangle", "color": ALERT, "size": "2.6", "outline_color": "white"})
    root.appendChild(QgsRuleBasedRenderer.Rule(up, label="photo that looks up", elseRule=True))
    layer.setRenderer(QgsRuleBasedRenderer(root))
    layer.setDisplayExpression('"image"')
    # Over a town they lie on what people look for.
    layer.setScaleBasedVisibility(True)
    layer.setMinimumScale(1000)
    return layer


def qa_issues():
    layer = QgsVectorLayer(
        "Point?crs=EPSG:25832&field=code:string&field=severity:string&field=message:string", "qa_issues", "memory"
    )
    root = QgsRuleBasedRenderer.Rule(None)
    # As large as a small house (8, 7 and 5 m), at most as large as is easy to see and at least as a dot: on the map of a town marks
    # would bury the houses else.
    for severity, colour, size_m, most_mm in [("refused", "#d55e00", 8, 3.6), ("warning", "#e69f00", 7, 3), ("note", "#8c8c92", 5, 2.2)]:
        symbol = QgsMarkerSymbol.createSimple({
            "name": "diamond", "color": colour, "outline_color": "white", "outline_width": "0.1", "size": str(size_m),
            "size_unit": "RenderMetersInMapUnits", "size_map_unit_scale": f"3x:0,0,1,0.7,1,{most_mm}",
        })
        root.appendChild(QgsRuleBasedRenderer.Rule(symbol, filterExp=f"\"severity\" = '{severity}'", label=severity))
    layer.setRenderer(QgsRuleBasedRenderer(root))
    layer.setDisplayExpression("\"code\" || ': ' || \"message\"")
    # Heights are written beside the marks, not under them.
    blocking = QgsPalLayerSettings()
    blocking.drawLabels = False
    obstacle = QgsLabelObstacleSettings()
    obstacle.setIsObstacle(True)
    obstacle.setFactor(2)
    blocking.setObstacleSettings(obstacle)
    layer.setLabeling(QgsVectorLayerSimpleLabeling(blocking))
    layer.setLabelsEnabled(True)
    return layer


def tiles():
    layer = QgsVectorLayer("Polygon?crs=EPSG:25832&field=tile:string&field=status:string", "tiles", "memory")
    root = QgsRuleBasedRenderer.Rule(None)
    frame = {"style": "no", "outline_width": "0.4", "outline_style": "dash"}
    done = QgsFillSymbol.createSimple({**frame, "outline_color": "125,125,132,255"})
    other = QgsFillSymbol.createSimple({**frame, "outline_color": "213,94,0,255"})
    root.appendChild(QgsRuleBasedRenderer.Rule(done, filterExp="\"status\" = 'done'", label="tile"))
    root.appendChild(QgsRuleBasedRenderer.Rule(other, label="tile that is not done", elseRule=True))
    layer.setRenderer(QgsRuleBasedRenderer(root))
    layer.setDisplayExpression("\"tile\" || ': ' || \"status\"")
    return layer


def polygon_rules(name, attributes, rules):
    """A layer of footprints without filling: (label, filter or None for the rest, symbol properties)."""
    layer = QgsVectorLayer(f"Polygon?crs=EPSG:25832&{attributes}", name, "memory")
    root = QgsRuleBasedRenderer.Rule(None)
    for label, expression, properties in rules:
        symbol = QgsFillSymbol.createSimple(properties)
        if expression is None:
            root.appendChild(QgsRuleBasedRenderer.Rule(symbol, label=label, elseRule=True))
        else:
            root.appendChild(QgsRuleBasedRenderer.Rule(symbol, filterExp=expression, label=label))
    layer.setRenderer(QgsRuleBasedRenderer(root))
    return layer


def footprints_moved():
    style = {"style": "no", "outline_color": "213,94,0,255", "outline_width": "0.5", "outline_style": "dash"}
    layer = polygon_rules("footprints_moved", "field=id:string&field=off_east_m:double&field=off_north_m:double", [("where the photos show it", None, style)])
    layer.setDisplayExpression("\"id\"")
    layer.setMapTipTemplate(
        "<b>[% \"id\" %]</b><br>the footprint given lies [% format_number(\"off_east_m\", 1) %] m east and"
        " [% format_number(\"off_north_m\", 1) %] m north of it"
    )
    return layer


def footprints():
    """How sure: few photos that agree less are what people should look at first."""

    def fill(colour):
        return {"color": colour, "outline_color": "45,45,52,255", "outline_width": "0.3"}

    layer = polygon_rules(
        "footprints",
        "field=id:string&field=n_views:integer&field=n_seen:integer&field=footprint_confidence:double"
        "&field=sigma_m:double&field=cadastre:string",
        [
            ("confidence 0.8 and more", '"footprint_confidence" >= 0.8', fill("33,145,140,150")),
            ("0.5 to 0.8", '"footprint_confidence" >= 0.5 AND "footprint_confidence" < 0.8', fill("94,201,98,150")),
            ("below 0.5: look at it", '"footprint_confidence" < 0.5', fill("253,231,37,190")),
            ("of the cadastre, seen by no photo", None, {**fill("140,140,146,255"), "style": "b_diagonal"}),
        ],
    )
    layer.setDisplayExpression("\"id\"")
    layer.setMapTipTemplate(
        "<b>[% \"id\" %]</b><br>[% \"n_views\" %] of [% \"n_seen\" %] photos"
        "<br>corners ± [% coalesce(format_number(\"sigma_m\", 2) || ' m', 'not known') %]<br>[% \"cadastre\" %]"
    )
    return layer


def candidates():
    def line(colour, style="solid"):
        return {"style": "no", "outline_color": colour, "outline_width": "0.2", "outline_style": style}

    layer = polygon_rules(
        "candidates",
        "field=view:string&field=building:string&field=cut:integer",
        [
            ("left out", '"building" IS NULL', line("213,94,0,255")),
            ("cut off by the photo's border", '"cut" = 1', line("0,114,178,140", "dash")),
            ("of one photo", None, line("0,114,178,140")),
        ],
    )
    layer.setDisplayExpression("\"view\" || coalesce(': ' || \"building\", '')")
    return layer


def vanished():
    style = {"color": "213,94,0,255", "style": "diagonal_x", "outline_color": "213,94,0,255", "outline_width": "0.4"}
    layer = polygon_rules("vanished", "field=id:string", [("gone: the photos do not show it", None, style)])
    layer.setDisplayExpression("\"id\"")
    return layer


def changes():
    """What became of each building: Okabe and Ito's colours for what has changed, grey for what has not."""

    def fill(colour):
        return {"color": f"{colour},255", "outline_color": "45,45,52,255", "outline_width": "0.2"}

    classes = [
        ("new", "new", "0,158,115"),
        ("gone", "gone", "213,94,0"),
        ("raised", "raised", "0,114,178"),
        ("lowered", "lowered", "86,180,233"),
        ("other footprint", "footprint_changed", "204,121,167"),
        ("same", "same", "225,225,222"),
        ("unsure", "unsure", "240,228,66"),
        ("outside the other result", "outside", "170,170,175"),
    ]
    layer = polygon_rules(
        "changes",
        "field=class:string&field=new_id:string&field=old_id:string&field=explanation:string",
        [(label, f"\"class\" = '{name}'", fill(colour)) for label, name, colour in classes],
    )
    layer.setDisplayExpression("\"class\" || ': ' || coalesce(\"new_id\", \"old_id\")")
    layer.setMapTipTemplate(
        "<b>[% \"class\" %]</b> [% coalesce(\"new_id\", '') %]<br>was: [% coalesce(\"old_id\", 'nothing') %]<br>[% \"explanation\" %]"
    )
    return layer


def export(layer, folder):
    """Writes the layer's style, with rule keys that do not change from run to run."""
    document = QDomDocument("qgis")
    categories = QgsMapLayer.Symbology | QgsMapLayer.Symbology3D | QgsMapLayer.MapTips | QgsMapLayer.Labeling
    if layer.hasScaleBasedVisibility():
        categories |= QgsMapLayer.Rendering
    message = layer.exportNamedStyle(document, QgsReadWriteContext(), categories)
    if message:
        raise SystemExit(f"cannot export the style of {layer.name()}: {message}")
    (Path(folder) / f"{layer.name()}.qml").write_text(with_stable_keys(document.toString(2)), encoding="utf-8")


# A family that is not on the reader's machine makes QGIS warn when it opens the project; without one it takes its own.
FONT_FAMILY = re.compile(r' fontFamily="[^"]*"')


def with_stable_keys(text):
    keys = {}
    text = FONT_FAMILY.sub("", text)

    def stable(match):
        keys.setdefault(match.group(0), f"{{00000000-0000-4000-8000-{len(keys):012}}}")
        return keys[match.group(0)]

    return re.sub(r"\{[0-9a-f]{8}-[0-9a-f-]{27}\}", stable, text)


# What the program writes in place of these words.
TITLE, PLACE, SOURCES = "SIZEUP_TITLE", "SIZEUP_PLACE", "SIZEUP_SOURCES"
# Frame of the map on an A4 page, millimetres from the upper left: x, y, width, height.
MAP_FRAME = (10, 22, 210, 168)


def layout():
    """A page with map, legend, scale, north arrow, title and sources; the program sets the map's extent."""
    page = QgsPrintLayout(QgsProject.instance())
    page.initializeDefaults()
    page.setName("Map, A4")

    def place(item, name, x, y, width, height):
        item.setId(name)
        page.addLayoutItem(item)
        item.attemptMove(QgsLayoutPoint(x, y, QgsUnitTypes.LayoutMillimeters))
        item.attemptResize(QgsLayoutSize(width, height, QgsUnitTypes.LayoutMillimeters))
        return item

    def label(name, text, size, x, y, width, height):
        item = QgsLayoutItemLabel(page)
        item.setText(text)
        font = QFont("Sans Serif")
        font.setPointSizeF(size)
        item.setFont(font)
        place(item, name, x, y, width, height)

    chart = place(QgsLayoutItemMap(page), "map", *MAP_FRAME)
    chart.setExtent(QgsRectangle(0, 0, MAP_FRAME[2], MAP_FRAME[3]))
    chart.setFrameEnabled(True)
    label("title", TITLE, 16, 10, 6, 277, 8)
    label("place", PLACE, 9, 10, 15, 277, 6)
    legend = QgsLayoutItemLegend(page)
    legend.setLinkedMap(chart)
    legend.setAutoUpdateModel(True)
    # Only what is on the map: the page has no room for what is not drawn.
    legend.setLegendFilterByMapEnabled(True)
    for style, points in [
        (QgsLegendStyle.Group, 9), (QgsLegendStyle.Subgroup, 8), (QgsLegendStyle.SymbolLabel, 7)
    ]:
        font = QFont("Sans Serif")
        font.setPointSizeF(points)
        legend.setStyleFont(style, font)
    legend.setSymbolHeight(3.2)
    place(legend, "legend", 224, 22, 63, 120)
    scale = QgsLayoutItemScaleBar(page)
    scale.setStyle("Single Box")
    scale.setLinkedMap(chart)
    scale.setUnits(QgsUnitTypes.DistanceMeters)
    scale.setUnitLabel("m")
    scale.setSegmentSizeMode(QgsScaleBarSettings.SegmentSizeFitWidth)
    scale.setMinimumBarWidth(25)
    scale.setMaximumBarWidth(55)
    scale.setNumberOfSegments(2)
    scale.setNumberOfSegmentsLeft(0)
    numbers = QgsTextFormat()
    numbers.setSize(8)
    scale.setTextFormat(numbers)
    scale.setHeight(2)
    place(scale, "scale", 224, 178, 63, 12)
    arrow = QgsLayoutItemPicture(page)
    arrow.setPicturePath(":/images/north_arrows/layout_default_north_arrow.svg")
    arrow.setLinkedMap(chart)
    place(arrow, "north", 273, 158, 14, 16)
    label("sources", SOURCES, 7, 10, 192, 277, 14)
    return page


def write_layout(folder):
    document = QDomDocument("qgis")
    root = document.createElement("Layouts")
    root.appendChild(layout().writeXml(document, QgsReadWriteContext()))
    document.appendChild(root)
    (Path(folder) / "layout.xml").write_text(with_stable_keys(document.toString(1)), encoding="utf-8")


def main():
    if len(sys.argv) != 4:
        raise SystemExit(__doc__)
    application = QgsApplication([], False)
    application.initQgis()
    Qgs3D.initialize()
    for layer in [buildings(), blocks(), roofed(), footprints_moved(), tiles(), cameras(), qa_issues()]:
        export(layer, sys.argv[1])
    write_layout(sys.argv[1])
    for layer in [footprints(), candidates(), vanished()]:
        export(layer, sys.argv[2])
    export(changes(), sys.argv[3])
    application.exitQgis()


if __name__ == "__main__":
    main()
