"""Compares `sizeup run` with structure from motion: processor time, and heights from COLMAP's points, on the photos of one scene.

    python3 -m venv venv && venv/bin/pip install pycolmap
    venv/bin/python lab/colmap.py scene/sizeup.toml --truth scene/truth.geojson --output compared

The scene is a run configuration whose survey is a COLMAP model with one camera, such as `sizeup-lab simulate` writes. Every step is
a process of its own, bound to one core, with one thread. Processor time is user and system time of the process.

COLMAP extracts SIFT features on the CPU, matches pairs of photos, and triangulates points from the given poses. It gets the camera's
calibration, and each photo is matched with those that look at the nearest places (`--neighbours`; 0: every pair). With `--map` its
incremental mapper also finds the poses from the same matches. Heights from the points are those of `sizeup-lab baseline`.
"""

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path

# Percentiles and shapes of a point cloud that `sizeup-lab baseline` makes heights of.
BASELINES = ["points_p50", "points_p70", "points_p90"]
# Settings of sizeup by what the depth comes from. Files that only people look at are left out.
QUIET = ["--set", "output.pictures=false", "--set", "output.report.page=false"]


def colmap_step(step, survey, images, work, pairs):
    """Runs one step of COLMAP in this process."""
    import pycolmap

    database = work / "database.db"
    given = pycolmap.Reconstruction(survey)
    if step == "features":
        (camera,) = given.cameras.values()
        options = pycolmap.FeatureExtractionOptions(num_threads=1, use_gpu=False)
        reader = pycolmap.ImageReaderOptions(
            camera_model=camera.model.name, camera_params=",".join(repr(float(p)) for p in camera.params)
        )
        pycolmap.extract_features(
            database, images, image_names=sorted(image.name for image in given.images.values()),
            camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader, extraction_options=options,
            device=pycolmap.Device.cpu,
        )
    elif step == "matches":
        options = pycolmap.FeatureMatchingOptions(num_threads=1, use_gpu=False)
        pairing = pycolmap.ImportedPairingOptions(match_list_path=str(pairs))
        pycolmap.match_image_pairs(
            database, matching_options=options, pairing_options=pairing, device=pycolmap.Device.cpu
        )
    elif step == "points":
        out = work / "points"
        out.mkdir()
        options = pycolmap.IncrementalPipelineOptions(num_threads=1)
        found = pycolmap.triangulate_points(given, database, images, out, options=options)
        report(found)
        with open(work / "points.txt", "w", encoding="utf-8") as file:
            for point in found.points3D.values():
                file.write(" ".join(repr(float(v)) for v in point.xyz) + "\n")
    elif step == "mapping":
        out = work / "mapped"
        out.mkdir()
        options = pycolmap.IncrementalPipelineOptions(num_threads=1)
        models = pycolmap.incremental_mapping(database, images, out, options=options)
        report(max(models.values(), key=lambda model: model.num_reg_images()))


def report(model):
    """Prints what a model holds, for the process that called this one."""
    print("RESULT " + json.dumps({
        "photos": model.num_reg_images(), "points": model.num_points3D(),
        "error_px": round(model.compute_mean_reprojection_error(), 3),
    }))


def measured(command):
    """Runs a command on one core; its processor seconds, wall seconds and output."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    begun = time.monotonic()
    process = subprocess.Popen(
        ["taskset", "-c", "0", *map(str, command)], env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    said = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    code = os.waitstatus_to_exitcode(status)
    # 5: some items of the input have no result.
    if code not in (0, 5):
        raise SystemExit(f"{' '.join(map(str, command))} ended with {code}:\n{said[-3000:]}")
    return {
        "cpu_s": round(usage.ru_utime + usage.ru_stime, 2), "wall_s": round(time.monotonic() - begun, 1),
        "peak_mb": round(usage.ru_maxrss / 1024),
    }, said


def poses(sparse):
    """Names, centres and axes of the photos of a COLMAP text model."""
    lines = [line for line in (sparse / "images.txt").read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    for line in lines[::2]:
        words = line.split()
        w, x, y, z, *t = map(float, words[1:8])
        n = math.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w / n, x / n, y / n, z / n
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        centre = [-sum(rows[i][k] * t[i] for i in range(3)) for k in range(3)]
        yield words[9], centre, rows[2]


def write_pairs(path, sparse, neighbours, ground_z_m):
    """Writes the pairs to match; their number. Each photo with those whose axes meet the ground nearest to its own; 0: all pairs."""
    places = {}
    for name, centre, axis in poses(sparse):
        # An axis that does not go down meets the ground nowhere: its place is below the camera.
        reach = (centre[2] - ground_z_m) / -axis[2] if axis[2] < -0.1 else 0.0
        places[name] = [centre[k] + reach * axis[k] for k in range(2)]
    pairs = set()
    for name, place in places.items():
        others = sorted((math.dist(place, other), there) for there, other in places.items() if there != name)
        for _, there in others[: neighbours or None]:
            pairs.add(tuple(sorted((name, there))))
    path.write_text("".join(f"{a} {b}\n" for a, b in sorted(pairs)), encoding="utf-8")
    return len(pairs)


def errors(options, city, crs):
    """Number of buildings, mean and median error of their heights in metres, by `sizeup evaluate`."""
    if options.truth is None:
        return {}
    command = [options.sizeup, "evaluate", city, options.truth, "--heights-only", "--crs", crs, "--json", *options.evaluate]
    said = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    if said.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}:\n{said.stderr}")
    found = json.loads(said.stdout)["all"]
    return {name: round(found[name], 2) for name in ("n", "error_mean_m", "error_median_m")}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", type=Path)
    parser.add_argument("--output", type=Path, required=True, help="folder of the results, made anew")
    parser.add_argument("--truth", type=Path, help="layer of true heights, as for `sizeup evaluate`")
    parser.add_argument("--evaluate", action="append", default=[], help="one more argument of `sizeup evaluate`")
    parser.add_argument("--sizeup", default="sizeup", help="the program")
    parser.add_argument("--lab", default="sizeup-lab", help="the laboratory's program")
    parser.add_argument("--set", dest="settings", action="append", default=[], help="a setting of every run")
    parser.add_argument("--way", action="append", default=[], metavar="NAME=SETTING;SETTING",
                        help="a run of sizeup with its settings, as in stereo='prior={source=\"stereo\"}'")
    parser.add_argument("--neighbours", type=int, default=20, help="photos that each photo is matched with; 0: all")
    parser.add_argument("--map", action="store_true", help="also run COLMAP's incremental mapper")
    parser.add_argument("--step", help=argparse.SUPPRESS)
    options = parser.parse_args()

    folder = options.config.resolve().parent
    config = tomllib.loads(options.config.read_text(encoding="utf-8"))
    survey = folder / config["survey"]["path"]
    images = folder / config["survey"]["images"]
    offset = config["survey"].get("offset", [0.0, 0.0, 0.0])
    crs = config["project"]["crs"]
    work = options.output.resolve() / "colmap"
    pairs = work / "pairs.txt"
    if options.step:
        colmap_step(options.step, survey, images, work, pairs)
        return

    if (folder / "prior-cache").exists():
        raise SystemExit(f"{folder / 'prior-cache'} has depth of an earlier run, which would cost nothing here: move it away")
    shutil.rmtree(options.output, ignore_errors=True)
    work.mkdir(parents=True)
    # The level below half of the tie points, which is near enough to the ground to choose pairs.
    z = sorted(float(line.split()[3]) for line in (survey / "points3D.txt").read_text().splitlines() if line[:1] not in "#")
    n_pairs = write_pairs(pairs, survey, options.neighbours, z[len(z) // 2] if z else 0.0)

    table = {"n_photos": sum(1 for _ in poses(survey)), "n_pairs": n_pairs, "colmap": {}, "sizeup": {}, "points": {}}

    def keep():
        (options.output / "compared.json").write_text(json.dumps(table, indent=2), encoding="utf-8")

    for step in ["features", "matches", "points", *(["mapping"] if options.map else [])]:
        command = [sys.executable, __file__, options.config, "--output", options.output, "--step", step]
        row, said = measured(command)
        result = re.search(r"^RESULT (.*)$", said, re.M)
        table["colmap"][step] = {**row, **(json.loads(result[1]) if result else {})}
        print("colmap", step, table["colmap"][step], flush=True)
        keep()

    cloud = work / "points.xyz"
    with open(cloud, "w", encoding="utf-8") as file:
        for line in (work / "points.txt").read_text(encoding="utf-8").splitlines():
            file.write(" ".join(f"{float(v) + o:.3f}" for v, o in zip(line.split(), offset)) + "\n")
    sets = [part for setting in options.settings for part in ("--set", setting)]
    for method in BASELINES:
        out = options.output / method
        row, _ = measured([options.lab, "baseline", method, options.config, "--cloud", cloud, "--output", out, *sets])
        table["points"][method] = {**row, **errors(options, out / "city.city.json", crs)}
        print(method, table["points"][method], flush=True)
        keep()
    for way in options.way or ["priors="]:
        name, _, settings = way.partition("=")
        out = options.output / name
        more = [part for setting in filter(None, settings.split(";")) for part in ("--set", setting)]
        row, _ = measured([
            options.sizeup, "run", options.config, "--threads", "1", "--output", out, *QUIET, *sets, *more,
        ])
        table["sizeup"][name] = {**row, **errors(options, out / "city.city.json", crs)}
        print("sizeup", name, table["sizeup"][name], flush=True)
        keep()


if __name__ == "__main__":
    main()
