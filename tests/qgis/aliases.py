"""Opens files in a real QGIS as a planner would, and reports what the fields of every layer are called, as JSON.

    /usr/bin/python3 tests/qgis/aliases.py city.gpkg city.qgs city.qgz

Of a GeoPackage every layer is opened by itself; `titles` are those that the file states in `gpkg_data_columns`, read
without QGIS.
"""

import json
import os
import sqlite3
import sys

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from qgis.core import QgsApplication, QgsProject, QgsVectorLayer
from qgis._3d import Qgs3D


def aliases(layer):
    return {field.name(): layer.attributeAlias(i) for i, field in enumerate(layer.fields())}


def of_geopackage(path):
    with sqlite3.connect(path) as database:
        names = [name for (name,) in database.execute("SELECT table_name FROM gpkg_contents WHERE data_type = 'features'")]
        rows = database.execute("SELECT table_name, column_name, title FROM gpkg_data_columns").fetchall()
    titles = {name: {} for name in names}
    for table, column, title in rows:
        titles[table][column] = title
    layers = {name: QgsVectorLayer(f"{path}|layername={name}", name, "ogr") for name in names}
    return {"layers": {name: aliases(layer) for name, layer in layers.items()}, "titles": titles}


def of_project(path):
    project = QgsProject.instance()
    project.read(path)
    layers = [layer for layer in project.mapLayers().values() if isinstance(layer, QgsVectorLayer)]
    report = {"layers": {layer.name(): aliases(layer) for layer in layers}}
    del layers
    project.clear()
    return report


def main():
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    application = QgsApplication([], False)
    application.initQgis()
    Qgs3D.initialize()
    report = [of_geopackage(path) if path.endswith(".gpkg") else of_project(path) for path in sys.argv[1:]]
    json.dump(report, sys.stdout, indent=1)
    application.exitQgis()


if __name__ == "__main__":
    main()
