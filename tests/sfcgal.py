"""Asks SFCGAL, the library behind PostGIS's 3D functions, about every solid of a CityJSON file.

    python tests/sfcgal.py city.city.json

Prints JSON: how many solids were looked at, and for each that is not valid its object, level of detail and why. SFCGAL takes a face for
planar within 1e-9 m.
"""

import json
import sys

from pysfcgal.geometry import Geometry


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        city = json.load(file)
    scale, origin = city["transform"]["scale"], city["transform"]["translate"]
    vertices = [" ".join(repr(o + i * s) for i, s, o in zip(vertex, scale, origin)) for vertex in city["vertices"]]
    n, faults = 0, []
    for name, thing in city["CityObjects"].items():
        for geometry in thing.get("geometry", []):
            if geometry["type"] != "Solid":
                continue
            n += 1
            faces = []
            for face in geometry["boundaries"][0]:
                rings = ("(" + ",".join(vertices[i] for i in [*ring, ring[0]]) + ")" for ring in face)
                faces.append("(" + ",".join(rings) + ")")
            solid = Geometry.from_wkt(f"SOLID Z(({','.join(faces)}))")
            if not solid.is_valid():
                faults.append({"object": name, "lod": geometry["lod"], "why": solid.is_valid_detail()[0]})
    json.dump({"n": n, "faults": faults}, sys.stdout)


if __name__ == "__main__":
    main()
