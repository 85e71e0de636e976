#!/usr/bin/env python3
"""Writes a simulated scene as photogrammetry programs and drones leave theirs, and draws the pictures of docs/from-your-software.md.

    tools/exports.py write SCENE FOLDER             folders odm, metashape, pix4d and dji below FOLDER
    tools/exports.py draw PROGRAM FOLDER CHROMIUM   what `sizeup` says of each of them, as docs/images/from-*.png

The poses are the scene's own, exact but for the digits that each format has; so this shows what the files look like and that
they are read, not how good a program's poses are. Needs GDAL's Python (Debian: python3-gdal, python3-numpy, python3-pil), and a browser
without windows for the pictures.
"""

import html
import json
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
from osgeo import osr
from PIL import Image, ImageChops

ROOT = Path(__file__).resolve().parents[1]
# How far the geoid lies above the ellipsoid there (EGM96): the scene's heights count from it, satellite receivers' do not.
GEOID_M = 39.9
UTM, PROJ = 25832, "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs +type=crs"


def transform(source, target):
    systems = []
    for code in (source, target):
        system = osr.SpatialReference()
        system.ImportFromEPSG(code)
        system.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
        systems.append(system)
    way = osr.CoordinateTransformation(*systems)
    return lambda x, y, z=0.0: np.array(way.TransformPoint(x, y, z))


TO_DEGREES, TO_ECEF = transform(UTM, 4326), transform(4979, 4978)


def quaternion(w, x, y, z):
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def rotation_vector(r):
    angle = np.arccos(np.clip((np.trace(r) - 1) / 2, -1, 1))
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    return axis / np.linalg.norm(axis) * angle


class Scene:
    """Poses in the map (EPSG:25832), and what all exports share."""

    def __init__(self, folder):
        self.folder = Path(folder)
        lines = [line for line in (self.folder / "sparse/cameras.txt").read_text().splitlines() if not line.startswith("#")]
        _, model, width, height, f, fy, cx, cy = lines[0].split()[:8]
        assert model == "PINHOLE" and f == fy, "a scene without lens distortion"
        self.size, self.f = (int(width), int(height)), float(f)
        assert (float(cx), float(cy)) == (self.size[0] / 2, self.size[1] / 2)
        offset = np.array(json.loads((self.folder / "georef.json").read_text())["offset"])
        self.views = []
        for line in (self.folder / "sparse/images.txt").read_text().splitlines():
            words = line.split()
            if len(words) == 10 and words[9].endswith(".jpg"):
                r, t = quaternion(*map(float, words[1:5])), np.array(words[5:8], float)
                self.views.append((words[9], r, offset - r.T @ t))
        self.views.sort(key=lambda view: view[0])

    def geodetic(self, centre):
        """Longitude, latitude, height, and the rotation from true east, north, up there to the map's axes."""
        lon, lat, _ = TO_DEGREES(*centre)
        north = transform(4326, UTM)(lon, lat + 1e-5)[:2] - transform(4326, UTM)(lon, lat)[:2]
        azimuth = np.arctan2(north[0], north[1])
        c, s = np.cos(azimuth), np.sin(azimuth)
        return np.array([lon, lat, centre[2] + GEOID_M]), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])

    def into(self, folder, photos):
        """Photos, footprints and terrain."""
        shutil.rmtree(folder, ignore_errors=True)
        (folder / photos).mkdir(parents=True)
        for name, _, _ in self.views:
            shutil.copy(self.folder / "images" / name, folder / photos / name)
        shutil.copy(self.folder / "footprints.gpkg", folder / "buildings.gpkg")
        shutil.copy(self.folder / "dtm.tif", folder / "terrain.tif")
        return folder


def odm(scene, folder):
    scene.into(folder, "images")
    width, height = scene.size
    camera = {"projection_type": "perspective", "width": width, "height": height, "focal": scene.f / max(scene.size), "k1": 0.0, "k2": 0.0}
    shots = []
    for name, r, centre in scene.views:
        position, _ = scene.geodetic(centre)
        properties = {"filename": name, "camera": "v2 simulated", "rotation": list(rotation_vector(r)), "translation": list(centre + [0, 0, GEOID_M])}
        shots.append({"type": "Feature", "properties": properties, "geometry": {"type": "Point", "coordinates": list(position)}})
    for name in ("odm_report", "odm_georeferencing"):
        (folder / name).mkdir()
    (folder / "odm_report/shots.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": shots}))
    (folder / "cameras.json").write_text(json.dumps({"v2 simulated": camera}))
    (folder / "odm_georeferencing/proj.txt").write_text(PROJ)
    (folder / "odm_georeferencing/coords.txt").write_text("WGS84 UTM 32N\n565000 5932000\n")


def metashape(scene, folder):
    scene.into(folder, "photos")
    width, height = scene.size
    cameras = []
    for i, (name, r, centre) in enumerate(scene.views):
        position, map_from_enu = scene.geodetic(centre)
        lon, lat = np.radians(position[:2])
        enu_from_ecef = np.array([
            [-np.sin(lon), np.cos(lon), 0],
            [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
            [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
        ])
        ecef_from_camera = (r @ map_from_enu @ enu_from_ecef).T
        matrix = np.vstack([np.column_stack([ecef_from_camera, TO_ECEF(*position)]), [0, 0, 0, 1]])
        numbers = " ".join(repr(float(v)) for v in matrix.flatten())
        cameras.append(f'<camera id="{i}" sensor_id="0" label="{Path(name).stem}"><transform>{numbers}</transform></camera>')
    size = f'<resolution width="{width}" height="{height}"/>'
    (folder / "cameras.xml").write_text(
        f'<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0"><chunk label="Chunk 1" enabled="true">'
        f'<sensors next_id="1"><sensor id="0" label="simulated" type="frame">{size}<calibration type="frame" class="adjusted">{size}'
        f'<f>{scene.f}</f></calibration></sensor></sensors>\n<cameras next_id="{len(cameras)}">' + "\n".join(cameras) +
        '</cameras>\n<transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>0 0 0</translation><scale>1</scale></transform>'
        '<reference>GEOGCS["WGS 84",DATUM["World Geodetic System 1984",SPHEROID["WGS 84",6378137,298.257223563]]]</reference>'
        '</chunk></document>\n')


def pix4d(scene, folder):
    scene.into(folder, "photos")
    params = folder / "town/1_initial/params"
    params.mkdir(parents=True)
    width, height = scene.size
    offset = np.array([565000.0, 5932000.0, 0.0])
    blocks = []
    for name, r, centre in scene.views:
        rows = ["%.9f %.9f %.9f" % tuple(row) for row in r]
        blocks.append("\n".join([
            f"{name} {width} {height}", f"{scene.f} 0 {width / 2}", f"0 {scene.f} {height / 2}", "0 0 1", "0 0 0", "0 0",
            "%.4f %.4f %.4f" % tuple(centre - offset), *rows]))
    header = ("fileName imageWidth imageHeight\ncamera matrix K [3x3]\nradial distortion [3x1]\ntangential distortion [2x1]\n"
              "camera position t [3x1]\ncamera rotation R [3x3]\ncamera model m = K [R|-Rt] X\n\n")
    (params / "town_calibrated_camera_parameters.txt").write_text(header + "\n".join(blocks) + "\n")
    (params / "town_offset.xyz").write_text("%.3f %.3f %.3f\n" % tuple(offset))
    system = osr.SpatialReference()
    system.ImportFromEPSG(UTM)
    (params / "town_wkt.prj").write_text(system.ExportToWkt())


def dji(scene, folder):
    scene.into(folder, "DCIM")
    for name, r, centre in scene.views:
        (lon, lat, height), map_from_enu = scene.geodetic(centre)
        r = r @ map_from_enu
        # camera_from_enu: the third row is where it looks.
        forward, right = r[2], r[0]
        pitch = np.degrees(np.arcsin(np.clip(forward[2], -1, 1)))
        # Straight down, where it looks has no direction: the top of the photo has.
        ahead = forward if abs(forward[2]) < 0.9999 else -r[1]
        yaw = np.degrees(np.arctan2(ahead[0], ahead[1]))
        level = np.array([np.cos(np.radians(yaw)), -np.sin(np.radians(yaw)), 0.0])
        roll = np.degrees(np.arctan2(-right @ np.cross(level, forward), right @ level))
        tags = {
            "GpsLatitude": f"{lat:+.9f}", "GpsLongitude": f"{lon:+.9f}", "AbsoluteAltitude": f"{height:+.3f}",
            "GimbalYawDegree": f"{yaw:+.2f}", "GimbalPitchDegree": f"{pitch:+.2f}", "GimbalRollDegree": f"{roll:+.2f}", "RtkFlag": "50",
            "CalibratedFocalLength": f"{scene.f:.3f}", "CalibratedOpticalCenterX": f"{scene.size[0] / 2}",
            "CalibratedOpticalCenterY": f"{scene.size[1] / 2}",
        }
        attributes = " ".join(f'drone-dji:{key}="{value}"' for key, value in tags.items())
        packet = (b"http://ns.adobe.com/xap/1.0/\0" + (
            '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
            f'<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" {attributes}/></rdf:RDF></x:xmpmeta>').encode())
        path = folder / "DCIM" / name
        photo = path.read_bytes()
        path.write_bytes(photo[:2] + b"\xff\xe1" + struct.pack(">H", len(packet) + 2) + packet + photo[2:])


WRITERS = {"odm": odm, "metashape": metashape, "pix4d": pix4d, "dji": dji}


def tree(folder, made=()):
    """The folder as `tree` shows it, long lists shortened."""
    lines = []

    def walk(path, indent):
        entries = sorted((entry for entry in path.iterdir() if entry.name not in made), key=lambda e: (e.is_file(), e.name))
        photos = [entry for entry in entries if entry.suffix == ".jpg"]
        for entry in entries:
            if entry in photos[1:]:
                continue
            more = f"  … {len(photos)} photos" if photos and entry == photos[0] else ""
            lines.append(f"{indent}{entry.name}{'/' if entry.is_dir() else ''}{more}")
            if entry.is_dir():
                walk(entry, indent + "   ")

    walk(folder, "   ")
    return f"{folder.name}/\n" + "\n".join(lines)


STYLE = """body { margin: 0; background: #fff; font: 13px/1.35 'DejaVu Sans Mono', monospace; color: #24242a; width: 1000px }
main { display: grid; grid-template-columns: 360px 1fr; gap: 14px; padding: 14px } pre { margin: 0; white-space: pre-wrap }
.box { border: 1px solid #c9c9d0; border-radius: 6px; padding: 10px 12px; background: #fafafa }
.wide { grid-column: 1 / 3; background: #24242c; color: #e8e8ee } .wide b { color: #9bd4ff } img { width: 100%; display: block }"""


def shrink(picture):
    """Cuts off the white below the page, and keeps 64 colours."""
    image = Image.open(picture).convert("RGB")
    white = Image.new("RGB", image.size, "white")
    bottom = ImageChops.difference(image, white).getbbox()[3]
    image = image.crop((0, 0, image.width, min(bottom + 14, image.height))).resize((900, round((bottom + 14) * 0.9)), Image.LANCZOS)
    image.quantize(64, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(picture, optimize=True)


def draw(program, folder, chromium):
    folder = Path(folder).resolve()
    for name in WRITERS:
        project = folder / name
        before = tree(project, {"result"})
        said = []
        (folder / "sizeup.toml").unlink(missing_ok=True)
        for words in (["init", name], ["survey", "inspect", "--config", "sizeup.toml", "--picture", "survey.png"]):
            outcome = subprocess.run([program, *words], cwd=folder, capture_output=True, text=True, check=False)
            text = (outcome.stdout + outcome.stderr).replace(str(folder) + "/", "").rstrip()
            said.append(f"<b>$ sizeup {' '.join(words)}</b>\n{html.escape(text)}")
        page = folder / f"{name}.html"
        page.write_text(
            f"<!doctype html><meta charset=utf-8><style>{STYLE}</style><main><div class=box><pre>{html.escape(before)}</pre></div>"
            f"<div class=box><img src='survey.png'></div><div class='box wide'><pre>" + "\n\n".join(said) + "</pre></div></main>")
        picture = ROOT / f"docs/images/from-{name}.png"
        subprocess.run(
            [chromium, "--no-sandbox", "--headless", "--hide-scrollbars", f"--screenshot={picture}", "--window-size=1000,1400", page.as_uri()],
            check=True, capture_output=True)
        shrink(picture)
        print(picture, picture.stat().st_size)


def main():
    match sys.argv[1:]:
        case ["write", scene, folder]:
            for name, writer in WRITERS.items():
                writer(Scene(scene), Path(folder) / name)
        case ["draw", program, folder, chromium]:
            draw(str(Path(program).resolve()), folder, chromium)
        case _:
            raise SystemExit(__doc__)


if __name__ == "__main__":
    main()
