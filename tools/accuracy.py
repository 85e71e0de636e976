#!/usr/bin/env python3
"""Measures the tables of docs/accuracy.md and lab/methods.md, and writes them there.

tools/accuracy.py measure PROGRAM FOLDER [DATA]   every suite below into FOLDER; what is there already is not run again.
                                                  `sizeup-lab` lies beside PROGRAM. DATA: the folder of real data, without which suites that need it are left out
tools/accuracy.py write FOLDER [DOCUMENT ...]     the tables between `<!-- NAME -->` and `<!-- /NAME -->` of both; those whose suites are
                                                  not in FOLDER stay as they are

No setting of the program was chosen on these seeds. Rotterdam as a whole and Delft were looked at when the windows of the search were settled; roof forms
and all since were chosen on the western half of Rotterdam.
"""
import json
import pathlib
import subprocess
import sys

LEVELS = ["clean", "mid", "high", "bleed"]
TOWNS = ["village", "district", "downtown"]
METHODS = ["robust", "paper", "metric_lift", "regression_l1", "regression_l2"]
DOCUMENTS = ["docs/accuracy.md", "lab/methods.md"]
PHOTOS = "photo_px=[800,600]"
# Errors of poses: metres and degrees.
POSES = {"exact": (0, 0), "RTK": (0.1, 0.3), "poor RTK": (0.3, 0.5), "GNSS": (0.3, 1.0)}
ROTTERDAM = "rotterdam_lod2/rotterdam_delfshaven.city.json"
CAMERAS = "rotterdam_oblique_cameras/camera_parameters.txt"
DELFT = "delft_lidar_lod1/output/testarea.json"


def real(data):
    """The towns of real buildings, as `sizeup-lab benchmark` takes them."""
    city = f'path="{data / ROTTERDAM}",bounds_m=[90830,435400,91350,436100],max_buildings=80,trees_per_building=1'
    survey = f'path="{data / CAMERAS}",crs="EPSG:7415",csv={{name="image_id",angles="opk",sequence="zyx",direction="world_to_camera"}}'
    cameras = f'survey={{{survey}}},crs="EPSG:7415",at_m=[90597,437641]'
    return ",".join([
        f'{{name="Rotterdam, real cameras",cityjson={{{city},translation_m=[-493,1891,0]}},cameras={{{cameras}}}}}',
        f'{{name="Rotterdam, simulated flight",cityjson={{{city}}}}}',
        f'{{name="Delft, simulated flight",cityjson={{path="{data / DELFT}",max_buildings=160,trees_per_building=1}}}}',
    ])


def run(*arguments):
    print(" ".join(map(str, arguments)), file=sys.stderr, flush=True)
    return subprocess.run(list(map(str, arguments)), check=True, capture_output=True, text=True).stdout


def lab_of(program):
    """The laboratory's program, built beside the program."""
    return pathlib.Path(program).with_name("sizeup-lab")


def benchmark(program, folder, *settings):
    run(lab_of(program), "benchmark", "accuracy", "--output", folder, *(part for setting in settings for part in ("--set", setting)))


def alone(program, folder, kind, poses):
    """A town from its photos alone: what `sizeup evaluate` says of it."""
    told = folder / "told.json"
    if told.exists():
        return
    position_m, angle_deg = POSES[poses]
    scene = {"seed": 71, "town.n_buildings": 30, "flight.n_views": 70, "camera.width_px": 800, "camera.height_px": 600,
             "errors.position_m": position_m, "errors.angle_deg": angle_deg}
    run(lab_of(program), "simulate", "--preset", kind, *(part for key, value in scene.items() for part in ("--set", f"{key}={value}")), "--output", folder)
    text = (folder / "sizeup.toml").read_text()
    before, rest = text.split("[prior]", 1)
    after = rest[rest.index("\n["):] if "\n[" in rest else "\n"
    (folder / "photos.toml").write_text(f'{before}[prior]\nsource = "stereo"\n{after}')
    done = subprocess.run([program, "run", folder / "photos.toml", "--output", folder / "result"], capture_output=True, text=True)
    if done.returncode not in (0, 5):
        sys.exit(done.stderr)
    evaluated = json.loads(run(program, "evaluate", folder / "result/city.city.json", folder / "truth.geojson", "--json"))
    evaluated["was_aligned"] = (folder / "result/align.json").exists()
    told.write_text(json.dumps(evaluated))


def measure(program, folder, data):
    folder.mkdir(parents=True, exist_ok=True)
    held_out = "seeds=[71,72,73,74,75]"
    robust = f"methods={json.dumps(METHODS[:1])}"
    benchmark(program, folder / "towns", held_out, robust)
    # The longest: of methods that do not change with the solver.
    benchmark(program, folder / "methods", held_out, f"methods={json.dumps(METHODS[1:])}")
    benchmark(program, folder / "photos", "seeds=[71,72]", PHOTOS, robust, 'levels=["mid","high"]')
    for kind in ["village", "district"]:
        for poses in POSES:
            alone(program, folder / f"alone-{kind}-{poses.replace(' ', '-')}", kind, poses)
    if data:
        towns = ["towns=[]", f"real=[{real(data)}]", robust]
        benchmark(program, folder / "real", "seeds=[1,2]", *towns)
        benchmark(program, folder / "real-photos", "seeds=[1]", PHOTOS, 'levels=["mid","high"]', *towns)


def percent(share):
    return "–" if share is None else f"{100 * share:.0f}"


COLUMNS = ["n", "mean m", "median m", "P90 m", "max m", "bias m", "≤ 1 m", "> 2 m and `measured`", "no height", "within 1, 2 σ"]


def cells(statistics, n_misleading, n_without):
    s = statistics
    lengths = [f"{s[key]:.2f}" for key in ["error_mean_m", "error_median_m", "error_p90_m", "error_max_m"]]
    sigmas = [percent(s.get(f"within_{k}_sigma_share")) for k in (1, 2)]
    within = "–" if "–" in sigmas else f"{sigmas[0]}, {sigmas[1]} %"
    return [s["n"], *lengths, f"{s['bias_m']:+.2f}", f"{percent(s['within_1m_share'])} %", n_misleading, n_without, within]


def table(names, rows):
    lines = ["| " + " | ".join(names + COLUMNS) + " |", "|" + "---|" * len(names) + "---:|" * len(COLUMNS)]
    return "\n".join(lines + ["| " + " | ".join(map(str, row)) + " |" for row in rows])


def of_suites(folders, keys, wanted=lambda row: True):
    """The rows of suites, by level and then as they have them."""
    told = [json.loads((one / "accuracy.json").read_text())["rows"] for one in folders]
    rows = [row for of_one in told for row in of_one if wanted(row)]
    rows.sort(key=lambda row: LEVELS.index(row["level"]))
    name = lambda row, key: f"`{row[key]}`" if key == "method" else row[key]
    return [[name(row, key) for key in keys] + cells(row["statistics"], row["n_misleading"], row["n_without_height"]) for row in rows]


def tables(folder):
    has = lambda *suites: all((folder / suite / "accuracy.json").exists() for suite in suites)
    is_all = lambda row: row["town"] == "all"
    not_all = lambda row: not is_all(row)
    towns, real = ["priors", "town"], ["priors", "buildings and cameras"]
    if has("towns"):
        yield "towns", table(towns, of_suites([folder / "towns"], ["level", "town"]))
    if has("towns", "methods"):
        yield "methods", table(["priors", "method"], of_suites([folder / "towns", folder / "methods"], ["level", "method"], is_all))
    if has("photos"):
        yield "photos", table(towns, of_suites([folder / "photos"], ["level", "town"]))
    alone = [(kind, poses, folder / f"alone-{kind}-{poses.replace(' ', '-')}" / "told.json") for kind in ["village", "district"] for poses in POSES]
    if all(told.exists() for _, _, told in alone):
        yield "alone", table(["town", "poses off by", "aligned by the run"], [row_alone(*one) for one in alone])
    for suite in ["real", "real-photos"]:
        if has(suite):
            yield suite, table(real, of_suites([folder / suite], ["level", "town"], not_all))


def row_alone(kind, poses, path):
    told = json.loads(path.read_text())
    misleading = [b for b in told["buildings"] if b["status"] == "measured" and abs(b["signed_error_m"]) > 2]
    position_m, angle_deg = POSES[poses]
    error = "exact" if poses == "exact" else f"{position_m} m, {angle_deg}°"
    return [kind, error, "yes" if told["was_aligned"] else "no"] + cells(told["all"], len(misleading), told["counts"]["n_unobserved"])


def write(folder, documents):
    for name, body in tables(folder):
        start, end = f"<!-- {name} -->", f"<!-- /{name} -->"
        document = next((document for document in documents if start in document.read_text()), None)
        if document is None:
            sys.exit(f"no {start} in {', '.join(map(str, documents))}")
        head, rest = document.read_text().split(start, 1)
        document.write_text(head + start + "\n" + body + "\n" + end + rest.split(end, 1)[1])


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["measure", program, folder, *data]:
            measure(pathlib.Path(program).absolute(), pathlib.Path(folder), pathlib.Path(data[0]).absolute() if data else None)
        case ["write", folder, *documents]:
            write(pathlib.Path(folder), [pathlib.Path(document) for document in documents or DOCUMENTS])
        case _:
            sys.exit(__doc__)
