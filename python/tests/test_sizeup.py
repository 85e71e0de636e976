"""The package as installed: `python -m unittest discover python/tests`."""

import inspect
import json
import pathlib
import re
import runpy
import subprocess
import sys
import tempfile
import unittest
import warnings

import numpy as np

import sizeup

SQUARE = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]
CAMERA = sizeup.Camera(width_px=40, height_px=30, fx_px=38.0)
POSE = sizeup.Pose.looking_at([5.0, -60.0, 80.0], [5.0, 5.0, 0.0])


def view(**changes):
    return sizeup.View(**{"name": "a", "camera": CAMERA, "camera_from_map": POSE, "depth": np.ones((30, 40)), **changes})


def program(*words, **options):
    return subprocess.run([sys.executable, "-m", "sizeup", *words], capture_output=True, encoding="utf-8", check=False, **options)


class Arrays(unittest.TestCase):
    def test_the_example_finds_its_heights(self):
        runpy.run_path(str(pathlib.Path(__file__).parents[1] / "examples" / "heights_from_arrays.py"))

    def test_a_building_that_no_view_sees_says_so(self):
        (height,) = sizeup.estimate_heights([SQUARE], [view(depth=None)], ground_m=0.0)
        self.assertIsNone(height.height_m)
        self.assertEqual(height.reasons, ("seen_by_no_view",))

    def test_a_pose_puts_its_target_in_the_middle(self):
        point = np.array(POSE.rotation) @ [5.0, 5.0, 0.0] + POSE.translation
        np.testing.assert_allclose(point[:2], 0.0, atol=1e-9)
        self.assertGreater(point[2], 0.0)

    def test_geojson_holes_and_shapes_with_an_interface_are_footprints(self):
        hole = [[4.0, 4.0], [4.0, 6.0], [6.0, 6.0], [6.0, 4.0]]
        polygon = {"type": "Polygon", "coordinates": [SQUARE, hole]}
        shape = type("Shape", (), {"__geo_interface__": polygon})()
        found = [sizeup.estimate_heights([one], [view()], ground_m=0.0) for one in ([SQUARE, hole], polygon, shape)]
        self.assertEqual(found[0], found[1])
        self.assertEqual(found[0], found[2])

    def test_what_cannot_be_used_is_named_with_its_place_and_a_hint(self):
        bowtie = [SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]]
        nowhere = sizeup.Pose([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0, float("nan"), 0.0])
        skewed = sizeup.Pose([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]], [0.0, 0.0, 0.0])
        wrong = [
            (r"footprints\[1\]: ", dict(footprints=[SQUARE, bowtie])),
            (r"footprints\[0\]: expected an n × 2 array", dict(footprints=[[1.0, 2.0, 3.0]])),
            (r"footprints\[0\]: expected a Polygon, found MultiPolygon", dict(footprints=[{"type": "MultiPolygon", "coordinates": []}])),
            (r"views\[0\] \('a'\): depth: expected rows × columns", dict(views=[view(depth=np.ones((1, 30, 40)))])),
            (r"views\[0\] \(.a.\): camera_from_map: expected a rotation", dict(views=[view(camera_from_map=skewed)])),
            (r"views\[0\] \(.a.\): camera: focal length", dict(views=[view(camera=sizeup.Camera(40, 30, -1.0))])),
            (r"views\[0\] \('a'\): kind: expected depth or inverse_depth, found 'disparity'", dict(views=[view(kind="disparity")])),
            (r"views: a more than once", dict(views=[view(), view()])),
            (r"ground_m: expected one number or 1, one per footprint, found shape \(2,\)", dict(ground_m=[1.0, 2.0])),
            (r"ground of footprints\[0\]", dict(ground_m=float("nan"))),
            (r"views\[0\] \(.a.\): camera_from_map.translation: expected finite numbers", dict(views=[view(camera_from_map=nowhere)])),
        ]
        for message, changes in wrong:
            with self.subTest(message), self.assertRaisesRegex(sizeup.InputError, message) as caught:
                sizeup.estimate_heights(**{"footprints": [SQUARE], "views": [view()], "ground_m": 0.0, **changes})
            self.assertTrue(caught.exception.hint)
        for settings in ({"heights": {"most": 3}}, {"solver": {}}, {"heights": {"min_m": 9, "max_m": 3}}, {"optimise": {"stride_px": 0}}):
            with self.subTest(settings), self.assertRaises(sizeup.ConfigurationError) as caught:
                sizeup.estimate_heights([SQUARE], [view()], ground_m=0.0, settings=settings)
            self.assertTrue(caught.exception.hint)

    def test_an_error_is_a_value_error_and_says_its_hint(self):
        with self.assertRaises(ValueError) as caught:
            sizeup.estimate_heights([[[0.0, 0.0]]], [view()], ground_m=0.0)
        self.assertIn("\nhint: ", str(caught.exception))


class Program(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.demo = pathlib.Path(cls.folder.name) / "demo"
        done = program("demo", "--output", str(cls.demo))
        assert done.returncode == 0, done.stderr
        written = json.loads((cls.demo / "result" / "city.city.json").read_text(encoding="utf-8"))
        # A building in parts counts by its parts, as in the layers.
        cls.n_parts = sum(1 for thing in written["CityObjects"].values() if not thing.get("children"))
        assert cls.n_parts >= 41, "the buildings of the demo"

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_it_is_the_program_with_its_exit_codes(self):
        self.assertEqual(program("--version").stdout, f"sizeup {sizeup.__version__}\n")
        self.assertEqual(program("run").returncode, 2)

    def test_a_city_is_read_as_features_with_all_that_is_known(self):
        city = sizeup.read(self.demo / "result")
        self.assertEqual((len(city), city.crs), (self.n_parts, "EPSG:25832"))
        self.assertEqual(len(city.__geo_interface__["features"]), self.n_parts)
        building = city.buildings[0]
        self.assertEqual(building.geometry["type"], "Polygon")
        self.assertAlmostEqual(building.roof_z_m, building.ground_z_m + building.height_m)
        self.assertEqual(building.properties["id"], building.id)
        self.assertEqual(city.summary["n_buildings"], 41)
        layer = sizeup.read(self.demo / "result" / "city.gpkg")
        self.assertEqual([b.id for b in layer], [b.id for b in city])

    def test_a_frame_has_all_columns_of_the_geopackage_with_their_values(self):
        import geopandas

        frame = sizeup.read(self.demo / "result").to_geodataframe()
        layer = geopandas.read_file(self.demo / "result" / "city.gpkg", layer="buildings")
        self.assertEqual([c for c in frame.columns if c != "geometry"], [c for c in layer.columns if c != "geometry"])
        self.assertEqual(frame.crs, layer.crs)
        for column in layer.columns.drop("geometry"):
            with self.subTest(column):
                for found, written in zip(frame[column], layer[column], strict=True):
                    if found is None or found != found:
                        self.assertTrue(written is None or written != written, written)
                    elif column == "roof_planes":
                        for plane, other in zip(json.loads(found), json.loads(written), strict=True):
                            self.assertEqual(plane.keys(), other.keys())
                            np.testing.assert_allclose(plane["area_m2"], other["area_m2"], rtol=5e-4, atol=0.002)
                            np.testing.assert_allclose(plane["slope_deg"], other["slope_deg"], atol=0.05)
                    elif isinstance(found, float):
                        # Areas and volumes follow from heights and corners that the file has to the millimetre.
                        follows = column.endswith(("_m2", "_m3"))
                        self.assertAlmostEqual(found, written, delta=max(0.01, 5e-4 * abs(written)) if follows else 0.0011)
                    else:
                        self.assertEqual(found, written)
        np.testing.assert_allclose(frame.area, frame["footprint_area_m2"], atol=0.01)

    def test_buildings_are_found_by_id(self):
        city = sizeup.read(self.demo / "result")
        whole = next(b.part_of for b in city if b.part_of)
        building = city.buildings[3]
        self.assertIs(city[building.id], building)
        self.assertTrue(building.id in city and building in city)
        self.assertNotIn("nobody", city)
        with self.assertRaisesRegex(KeyError, "has no building 'nobody'; .* lists all ids"):
            city["nobody"]
        with self.assertRaisesRegex(KeyError, f"{whole}.* it is in parts: {whole}"):
            city[whole]

    def test_solids_are_closed_and_have_the_volume_and_the_walls_that_are_stated(self):
        city = sizeup.read(self.demo / "result")
        solids = city.solids()
        self.assertEqual(set(solids), {b.id for b in city if b.properties["no_solid_reason"] is None})
        n_pitched = 0
        for id, solid in solids.items():
            corners, triangles = np.array(solid.vertices), np.array(solid.triangles)
            edges = [edge for t in solid.triangles for edge in zip(t, [*t[1:], t[0]], strict=True)]
            self.assertEqual(sorted(edges), sorted((b, a) for a, b in edges), f"{id} is not closed")
            a, b, c = (corners[triangles[:, i]] - corners[0] for i in range(3))
            twice = np.cross(b - a, c - a)
            areas = np.linalg.norm(twice, axis=1) / 2
            row = city[id].properties
            self.assertAlmostEqual(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6, row["lod2_volume_m3"], delta=0.01)
            self.assertAlmostEqual(areas[np.array(solid.kinds) == "wall"].sum(), row["lod2_wall_area_m2"], delta=0.01)
            if row["roof_form"] not in (None, "flat") and row["lod2_wall_area_m2"] != row["wall_area_m2"]:
                n_pitched += 1
                planes = json.loads(row["roof_planes"])
                self.assertAlmostEqual(areas[np.array(solid.kinds) == "roof"].sum(), sum(p["area_m2"] for p in planes), delta=0.1)
        self.assertGreater(n_pitched, 3)

    def test_a_run_from_a_mapping_tells_its_progress_and_gives_the_files_heights(self):
        scene = self.demo / "scene"
        told = []
        config = {
            "seed": 1,
            "project": {"crs": "EPSG:25832"},
            "survey": {"path": scene / "sparse", "images": scene / "images", "offset": [565000.0, 5932000.0, 0.0]},
            "footprints": {"path": scene / "footprints.gpkg", "id_field": "id"},
            "terrain": {"dtm": scene / "dtm.tif"},
            "prior": {"source": "files", "path": str(scene / "priors" / "{stem}.npy"), "kind": "inverse_depth"},
        }
        city = sizeup.run(
            config, output=self.demo / "of mapping ü", settings={"refinement.enabled": False}, tell=told.append
        )
        self.assertEqual(city.summary["n_buildings"], 41)
        self.assertEqual([p.stage for p in told if p.event == "stage"], ["survey", "footprints", "heights", "output"])

    def test_errors_of_a_run_are_those_of_the_command_line(self):
        config = self.demo / "scene" / "sizeup.toml"
        with self.assertRaisesRegex(sizeup.ConfigurationError, "--set optimise.presett") as caught:
            sizeup.run(config, settings={"optimise.presett": "paper"})
        self.assertTrue(caught.exception.hint)
        with self.assertRaisesRegex(sizeup.InputError, "footprints") as caught:
            sizeup.run(config, settings={"footprints.path": str(self.demo / "nowhere.gpkg")}, output=self.demo / "none")
        self.assertEqual(caught.exception.code, 3)
        with self.assertRaisesRegex(sizeup.ConfigurationError, "cannot be written down"):
            sizeup.run({"seed": object()})

    def test_an_error_while_it_tells_stops_the_run(self):
        def tell(_):
            raise KeyboardInterrupt

        with self.assertRaises(KeyboardInterrupt):
            sizeup.run(self.demo / "scene" / "sizeup.toml", output=self.demo / "stopped", tell=tell)
        self.assertFalse((self.demo / "stopped" / "city.gpkg").exists())

    def test_results_whose_writer_has_not_come_to_its_end_are_warned_of_once(self):
        mark = self.demo / "result" / "UNFINISHED.txt"
        mark.write_text("a run was started and has not come to its end\nmore\n", encoding="utf-8")
        try:
            for path in (self.demo / "result", self.demo / "result" / "city.gpkg"):
                with self.assertWarnsRegex(UserWarning, "is not finished: a run was started") as caught:
                    self.assertEqual(len(sizeup.read(path)), self.n_parts)
                self.assertEqual(len(caught.warnings), 1)
        finally:
            mark.unlink()

    def test_a_folder_becomes_a_project_with_the_words_of_the_program(self):
        scene, config = self.demo / "scene", self.demo / "begun.toml"
        stated = {"crs": "EPSG:25832", "offset": (565000.0, 5932000.0, 0.0)}
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            project = sizeup.init(scene, output=config, **stated)
        self.assertEqual((project.config, project.is_complete, project.missing), (config, True, ()))
        self.assertEqual([str(warning.message) for warning in caught], list(project.warnings))
        self.assertEqual({warning.filename for warning in caught} - {__file__}, set(), "warned of where the user called")
        written = config.read_text(encoding="utf-8")
        words = ["--output", str(config), "--crs", "EPSG:25832", "--offset", "565000,5932000,0", "--force", "--json"]
        told = program("init", str(scene), *words)
        self.assertEqual(config.read_text(encoding="utf-8"), written)
        begun = json.loads(told.stdout)
        self.assertEqual(list(project.warnings), begun["warnings"])
        self.assertEqual(project.found["poses"], begun["poses"])
        with self.assertRaisesRegex(sizeup.ConfigurationError, "exists, and is not overwritten") as refused:
            sizeup.init(scene, output=config, **stated)
        self.assertIn("--force", refused.exception.hint)
        summary = sizeup.run(config, output=self.demo / "of init", settings={"refinement.enabled": False, "align.when": "never"}).summary
        self.assertEqual(summary["n_buildings"], 41)

    def test_what_a_folder_lacks_is_in_the_answer(self):
        project = sizeup.init(self.demo / "scene" / "sparse", output=self.demo / "lacking.toml", force=True)
        self.assertFalse(project.is_complete)
        self.assertTrue(all(lack.what and lack.why and lack.how for lack in project.missing))
        self.assertTrue(project.missing[0].what in project.config.read_text(encoding="utf-8"))
        with self.assertRaises(sizeup.InputError) as refused:
            sizeup.init(self.demo / "result" / "nothing here", output=self.demo / "none.toml")
        self.assertEqual(refused.exception.code, 3)

    def test_a_city_is_exported_as_the_program_does(self):
        city = sizeup.read(self.demo / "result")
        target = self.demo / "exports"
        target.mkdir()
        self.assertEqual(city.export(target / "city.gml"), target / "city.gml")
        program("export", str(self.demo / "result"), str(target / "program.gml"))
        self.assertEqual((target / "city.gml").read_bytes(), (target / "program.gml").read_bytes())
        again = sizeup.read(sizeup.export(city, target / "again.gpkg", project=True))
        self.assertEqual([b.id for b in again], [b.id for b in city])
        self.assertTrue((target / "again.qgs").is_file())
        sizeup.export(self.demo / "result", target / "cameras.geojson", layer="cameras")
        cameras = json.loads((target / "cameras.geojson").read_text(encoding="utf-8"))["features"]
        self.assertEqual(len(cameras), city.summary["n_views"])
        city.export(target / "tiles", to="3dtiles", geoid_height=45.5)
        self.assertTrue((target / "tiles" / "tileset.json").is_file())
        with self.assertRaisesRegex(sizeup.ConfigurationError, "Parquet") as refused:
            city.export(target / "city.parquet")
        self.assertIn("ogr2ogr", refused.exception.hint)
        with self.assertRaises(sizeup.InputError):
            sizeup.export(self.demo / "nowhere.gpkg", target / "city.obj")

    def test_a_result_is_compared_with_the_truth_and_with_itself(self):
        city, truth = sizeup.read(self.demo / "result"), self.demo / "scene" / "truth.geojson"
        measures = sizeup.evaluate(city, truth, heights_only=True)
        told = program("evaluate", str(self.demo / "result"), str(truth), "--heights-only", "--json")
        self.assertEqual(measures, json.loads(told.stdout))
        with self.assertRaisesRegex(sizeup.ConfigurationError, "0 to 100"):
            sizeup.evaluate(city, truth, roof_percentile=101)
        report = sizeup.changes(city, self.demo / "result" / "city.gpkg", self.demo / "changes", least_m=1.0)
        self.assertEqual(report["config"]["least_m"], 1.0)
        self.assertEqual({change["class"] for change in report["changes"]} - {"same", "unsure"}, set())
        self.assertEqual(sum(report["counts"].values()), len(report["changes"]))

    def test_keywords_are_the_options_of_the_program(self):
        for command in ("init", "export", "evaluate", "changes"):
            own = program(command, "--help").stdout.split("Everywhere:")[0]
            stated = set(re.findall(r"^ +(?:-\w, )?--([a-z0-9-]+)", own, re.MULTILINE)) - {"help", "version"}
            taken = set(inspect.signature(getattr(sizeup, command)).parameters)
            files = {"folder", "city", "result", "truth", "old", "new"} | ({"output"} if command == "export" else set())
            self.assertEqual({name.replace("_", "-") for name in taken - files}, stated, command)

    def test_warnings_of_the_program_are_pythons(self):
        mark = self.demo / "result" / "UNFINISHED.txt"
        mark.write_text("a run was started and has not come to its end\n", encoding="utf-8")
        try:
            with self.assertWarnsRegex(UserWarning, "is not finished: a run was started") as caught:
                sizeup.export(self.demo / "result", self.demo / "unfinished.csv")
            self.assertEqual((caught.filename, len(caught.warnings)), (__file__, 1))
        finally:
            mark.unlink()

    def test_what_is_no_city_is_refused(self):
        with self.assertRaisesRegex(sizeup.InputError, "no city.city.json"):
            sizeup.read(self.folder.name)
        with self.assertRaises(sizeup.InputError):
            sizeup.read(self.demo / "nowhere.gpkg")

    def test_tiles_are_run_by_the_same_program(self):
        done = program("run", str(self.demo / "scene" / "sizeup.toml"), "--tiled", "--output", str(self.demo / "tiled"), "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue(json.loads(done.stdout))


if __name__ == "__main__":
    unittest.main()
