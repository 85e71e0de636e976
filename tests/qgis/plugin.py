"""Tries the plugin in a real QGIS: its algorithms on a simulated scene, what people get wrong, and the review panel.

    /usr/bin/python3 tests/qgis/plugin.py SCENE PROGRAM PICTURES [unittest's options]

SCENE is a folder of `sizeup-lab simulate` with photos, CAMERAS of it projected by the program in `cameras.json`. Prints nothing
but what fails.
"""

import ast
import json
import os
import re
import shutil
import sqlite3
import stat
import subprocess
import sys
import tempfile
import time
import unittest
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
# Nothing of the user's own profile.
PROFILE = tempfile.mkdtemp(prefix="sizeup-qgis-")
os.environ["QGIS_CUSTOM_CONFIG_PATH"] = PROFILE

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "qgis"), "/usr/share/qgis/python", "/usr/share/qgis/python/plugins"]

from qgis.core import (
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsFeature,
    QgsFeatureRequest,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeatureSourceDefinition,
    QgsProcessingFeedback,
    QgsProject,
    QgsRectangle,
    QgsVectorLayer,
)
from qgis.gui import QgsMapCanvas
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtWidgets import QMainWindow

SCENE, PROGRAM, PICTURES = Path(), "", Path()
CRS = "EPSG:25832"
# Settings of a run whose heights and pictures do not matter, with a report and without.
WITH_PAGE = "optimise.working_px=160\nsurvey.accept_unsound=true\nrefinement.enabled=false\noutput.pictures=false"
QUICK = f"{WITH_PAGE}\noutput.report.page=false"


class Told(QgsProcessingFeedback):
    """Keeps what is told; cancels itself when so much is told."""

    def __init__(self, cancel_at=None):
        super().__init__(False)
        self.lines, self.percents, self.cancel_at = [], [], cancel_at
        self.progressChanged.connect(self.percents.append)

    def _keep(self, text):
        self.lines.append(text)
        if self.cancel_at is not None and self.cancel_at in text:
            self.cancel()

    def pushInfo(self, text):
        self._keep(text)

    def pushWarning(self, text):
        self._keep(text)

    def reportError(self, text, fatalError=False):
        self._keep(text)

    def setProgressText(self, text):
        self._keep(text)


class Interface:
    """What the panel takes of QGIS's main window."""

    def __init__(self):
        self._window, self._canvas = QMainWindow(), QgsMapCanvas()

    def mainWindow(self):
        return self._window

    def mapCanvas(self):
        return self._canvas


def run(algorithm, parameters, told=None):
    import processing

    context = QgsProcessingContext()
    context.setProject(QgsProject.instance())
    return processing.run(f"sizeup:{algorithm}", parameters, feedback=told or Told(), context=context)


def footprints():
    return QgsVectorLayer(str(SCENE / "footprints.gpkg"), "footprints", "ogr")


def heights(output, **more):
    return {
        "FOOTPRINTS": footprints(), "FOOTPRINTS_ID": "id", "SURVEY_FOLDER": str(SCENE / "sparse"),
        "IMAGES": str(SCENE / "images"), "CRS": QgsCoordinateReferenceSystem(CRS), "OFFSET": offset(),
        "DTM": str(SCENE / "dtm.tif"), "PRIOR_SOURCE": 2, "PRIOR_FILES": str(SCENE / "priors" / "{stem}.npy"),
        "PRIOR_KIND": 1, "MORE": f"{QUICK}\n# a comment", "OUTPUT": str(output), **more,
    }


def offset():
    text = (SCENE / "sizeup.toml").read_text(encoding="utf-8")
    return text.split("offset = [", 1)[1].split("]", 1)[0]


def set_program(path):
    from processing.core.ProcessingConfig import ProcessingConfig

    # Past the check of the dialog: a program may be taken away later.
    ProcessingConfig.settings["SIZEUP_PROGRAM"].value = str(path)


def script(folder, name, text):
    path = folder / name
    path.write_text("#!/bin/sh\n" + text, encoding="utf-8")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


class Case(unittest.TestCase):
    maxDiff = None

    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="Ergebnis für ", dir=SCENE))
        QgsProject.instance().clear()
        set_program(PROGRAM)

    def tearDown(self):
        QgsProject.instance().clear()
        shutil.rmtree(self.folder)

    def refused(self, algorithm, parameters, *words):
        told = Told()
        with self.assertRaises(QgsProcessingException) as caught:
            run(algorithm, parameters, told)
        said = "\n".join([str(caught.exception), *told.lines])
        for word in words:
            self.assertIn(word, said)
        return said


class Settings(unittest.TestCase):
    """The configuration file, without QGIS."""

    def test_a_file_reads_back_as_it_was_meant(self):
        try:
            import tomllib
        except ImportError:
            self.skipTest("this Python reads no TOML")
        from sizeup.config import Layer, Masks, Prior, RunSettings

        for name in ("Plan ü.gpkg", 'a "quoted" name.gpkg', "back\\slash.gpkg", "tab\there.gpkg"):
            run_settings = RunSettings(
                crs='PROJCRS["x"]', output="/out put", survey="/s", images="/i", offset=(1.0, -2.5, 0.0),
                footprints=Layer(f"/{name}", "Gebäude", "id"), ground_m=12, prior=Prior("files", "/p/{stem}.npy", "depth"),
                vertical_reference="DHHN2016", reviews="/out put/reviews.geojson",
            )
            read = tomllib.loads(run_settings.to_toml())
            self.assertEqual(read, {
                "project": {"crs": 'PROJCRS["x"]', "output": "/out put", "vertical_reference": "DHHN2016"},
                "survey": {"path": "/s", "offset": [1.0, -2.5, 0.0], "images": "/i"},
                "footprints": {"path": f"/{name}", "layer": "Gebäude", "id_field": "id"},
                "terrain": {"constant_m": 12.0},
                "prior": {"source": "files", "path": "/p/{stem}.npy", "kind": "depth"},
                "reviews": {"path": "/out put/reviews.geojson"},
            })
        masks = RunSettings(
            crs="EPSG:1", output="/o", survey="/s", dtm="/d.tif",
            footprints=Masks("/m/{stem}.png", "semantic", Layer("/c.gpkg")),
            prior=Prior("auto", model="/n.onnx", profile="moge"),
        )
        read = tomllib.loads(masks.to_toml())
        self.assertEqual(read["footprints"]["cadastre"], {"path": "/c.gpkg"})
        self.assertEqual(read["prior"], {"source": "auto", "model": "/n.onnx", "profile": "moge"})

    def test_what_is_missing_or_contradicts_itself_is_said(self):
        from sizeup.config import ConfigError, Layer, Prior, RunSettings, three_numbers

        base = {"crs": "EPSG:25832", "output": "/o", "survey": "/s", "footprints": Layer("/f.gpkg")}
        for more, word in [
            ({"dtm": "/d", "ground_m": 1.0}, "one of the two"),
            ({"survey": ""}, "no survey"),
            ({"prior": Prior("files", kind="depth")}, "{stem}"),
            ({"prior": Prior("files", "/p", "upside_down")}, "inverse"),
            ({"prior": Prior("network")}, "ONNX"),
        ]:
            with self.assertRaisesRegex(ConfigError, word):
                RunSettings(**{**base, **more}).to_toml()
        with self.assertRaisesRegex(ConfigError, "table.key=value"):
            RunSettings(**base, more=["seed=1\nnonsense"]).assignments()
        self.assertEqual(three_numbers(" 1, 2;3 "), (1.0, 2.0, 3.0))
        self.assertIsNone(three_numbers(" "))
        with self.assertRaises(ConfigError):
            three_numbers("1, 2")

    def test_the_bar_of_progress_never_goes_back_and_the_log_has_stages_and_quarters(self):
        from sizeup.progress import Progress

        now = [0.0]
        progress, percents, lines = Progress(lambda: now[0]), [], []
        for at_s, event in [
            (0, {"event": "stage", "stage": "survey", "share": 0.0}),
            (20, {"event": "stage", "stage": "heights", "share": 0.2}),
            (25, {"event": "advance", "what": "priors", "done": 1, "total": 2, "share": 0.24}),
            (30, {"event": "advance", "what": "epochs", "done": 1, "total": 2, "share": 0.3}),
            (31, {"event": "advance", "what": "tracing", "done": 0, "total": 9, "share": 0.28}),
            (32, {"event": "advance", "what": "anything", "done": 0, "total": 0}),
            (32, {"event": "message", "message": "x"}),
            (60, {"event": "stage", "stage": "output", "share": 0.6}), (99, {"event": "done", "code": 0}),
        ]:
            now[0] = at_s
            lines.append((progress.take(event), progress.left_s()))
            percents.append(progress.percent)
        self.assertEqual(percents, sorted(percents))
        self.assertEqual(percents[-1], 100.0)
        self.assertEqual([begun for begun, _ in lines if begun], ["survey", "heights", "quarter", "anything", "output"])
        # As long again as it took, by the share that is left.
        left = dict(line for line in lines if line[0])
        self.assertEqual((left["survey"], left["heights"], left["quarter"], left["output"]), (None, 80.0, 70.0, 40.0))
        # Commands that are no run have no time left, and a line for each work.
        looks = Progress(lambda: 60.0)
        self.assertEqual(looks.take({"event": "advance", "what": "photos", "done": 1, "total": 4}), "photos")
        self.assertEqual((looks.percent, looks.left_s()), (25.0, None))


class Words(unittest.TestCase):
    """Translations: all words have one, it fits into the dialogs, and it keeps what is filled in."""

    def said(self):
        """Every text in the code that people read."""
        texts = set()
        for path in (ROOT / "qgis" / "sizeup").rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "tr":
                    texts.add(ast.literal_eval(node.args[0]))
        return texts

    def test_german_and_french_have_all_words(self):
        texts = self.said()
        self.assertGreater(len(texts), 150)
        for language in ("de", "fr"):
            root = ElementTree.parse(ROOT / "qgis" / "sizeup" / "i18n" / f"sizeup_{language}.ts").getroot()
            self.assertEqual(root.get("language"), language)
            words = {m.findtext("source"): m.find("translation") for m in root.iter("message")}
            self.assertEqual(texts - set(words), set(), f"{language}: run pylupdate5 (CONTRIBUTING.md) and translate")
            for text in texts:
                translated = words[text]
                self.assertNotIn(translated.get("type"), ("unfinished", "obsolete"), text)
                self.assertTrue(translated.text, text)
                marks = re.compile(r"\{\w*\}|\w+\.(?:html|toml|gpkg|json|geojson|npy|png)\b")
                self.assertEqual(sorted(marks.findall(translated.text)), sorted(marks.findall(text)), text)

    def test_labels_fit_into_the_dialogs_as_qgis_opens_them(self):
        from processing.gui.AlgorithmDialog import AlgorithmDialog
        from qgis.gui import QgsCollapsibleGroupBoxBasic
        from qgis.PyQt.QtCore import QTranslator
        from qgis.PyQt.QtWidgets import QScrollArea

        if shutil.which("lrelease") is None:
            self.skipTest("no lrelease")
        set_program(PROGRAM)
        window = QMainWindow()
        for language in ("en", "de", "fr"):
            translator = QTranslator()
            if language != "en":
                made = Path(PROFILE) / f"sizeup_{language}.qm"
                source = ROOT / "qgis" / "sizeup" / "i18n" / f"sizeup_{language}.ts"
                subprocess.run(["lrelease", "-silent", source, "-qm", made], check=True)
                self.assertTrue(translator.load(str(made)))
                QgsApplication.installTranslator(translator)
            for algorithm in QgsApplication.processingRegistry().providerById("sizeup").algorithms():
                dialog = AlgorithmDialog(algorithm.create(), False, window)
                for group in dialog.mainWidget().findChildren(QgsCollapsibleGroupBoxBasic):
                    group.setCollapsed(False)
                dialog.show()
                QgsApplication.processEvents()
                for area in dialog.mainWidget().findChildren(QScrollArea):
                    self.assertEqual(area.horizontalScrollBar().maximum(), 0, (language, algorithm.name()))
                dialog.close()
                dialog.deleteLater()
            if language == "de":
                self.assertEqual(QgsApplication.translate("CityFromFolder", "Building footprints"), "Gebäudegrundrisse")
            QgsApplication.removeTranslator(translator)


class Cameras(unittest.TestCase):
    """The projection, held against the program's."""

    def test_pixels_are_those_of_the_program(self):
        from sizeup.review.camera import distort

        cases = json.loads((SCENE / "cameras.json").read_text(encoding="utf-8"))
        self.assertGreaterEqual(len(cases), 24)
        for case in cases:
            found = distort(case["lens"], *case["ideal"])
            if case["bent"] is None:
                self.assertIsNone(found, case)
                continue
            self.assertIsNotNone(found, case)
            for ours, theirs in zip(found, case["bent"]):
                self.assertAlmostEqual(ours, theirs, 9, case)


class Layers(Case):
    """Which layers are read as they are, and which are exported."""

    def footprints(self, layer, definition=None):
        from qgis.core import QgsProcessingFeatureSource

        from sizeup.layers import Footprints

        self.context = QgsProcessingContext()
        source = QgsProcessingFeatureSource(layer, self.context, False)
        return Footprints(layer, source, definition or layer, "id", QgsProject.instance().transformContext())

    def test_a_plain_file_is_read_as_it_is(self):
        layer = footprints()
        found = self.footprints(layer)
        self.assertFalse(found.is_exported)
        file = found.file(self.folder / "copy.gpkg")
        self.assertEqual((Path(file.path), file.id_field), (SCENE / "footprints.gpkg", "id"))
        self.assertFalse((self.folder / "copy.gpkg").exists())

    def test_memory_filters_and_other_crs_are_exported(self):
        memory = footprints().materialize(QgsFeatureRequest())
        filtered = footprints()
        filtered.setSubsetString("\"id\" IN ('b001', 'b002')")
        other = footprints()
        other.setCrs(QgsCoordinateReferenceSystem("EPSG:25833"))
        for layer, n, crs in [(memory, 6, CRS), (filtered, 2, CRS), (other, 6, "EPSG:25833")]:
            found = self.footprints(layer)
            self.assertTrue(found.is_exported)
            file = found.file(self.folder / "Kopie ü" / "copy.gpkg")
            copy = QgsVectorLayer(f"{file.path}|layername={file.layer}", "copy", "ogr")
            self.assertEqual((copy.featureCount(), copy.crs().authid()), (n, crs))
            self.assertEqual({f["id"] for f in copy.getFeatures()}, {f["id"] for f in layer.getFeatures()})
            shutil.rmtree(self.folder / "Kopie ü")

    def test_unsaved_edits_are_refused(self):
        layer = QgsVectorLayer(str(shutil.copy(SCENE / "footprints.gpkg", self.folder)), "being edited", "ogr")
        layer.startEditing()
        self.footprints(layer)
        layer.addFeature(QgsFeature(layer.fields()))
        QgsProject.instance().addMapLayer(layer)
        said = self.refused("heights", heights(self.folder / "r", FOOTPRINTS=layer), "unsaved edits", "being edited")
        self.assertNotIn("Traceback", said)
        layer.rollBack()

    def test_of_a_selection_only_what_is_selected_is_taken(self):
        layer = footprints()
        QgsProject.instance().addMapLayer(layer)
        layer.selectByExpression("\"id\" = 'b003' OR \"id\" = 'b005'")
        part = QgsProcessingFeatureSourceDefinition(layer.id(), True)
        output = self.folder / "result"
        run("heights", heights(output, FOOTPRINTS=part))
        city = QgsVectorLayer(f"{output}/city.gpkg|layername=buildings", "buildings", "ogr")
        self.assertEqual({f["id"] for f in city.getFeatures()}, {"b003", "b005"})
        self.assertTrue((output / "input" / "footprints.gpkg").is_file())


class Mistakes(Case):
    """What people get wrong, told in time and in words."""

    def test_degrees_are_refused_with_a_hint(self):
        for algorithm in ("heights", "inspectsurvey"):
            parameters = heights(self.folder / "r", CRS=QgsCoordinateReferenceSystem("EPSG:4326"))
            self.refused(algorithm, parameters, "geographic", "UTM")
        feet = QgsCoordinateReferenceSystem("EPSG:2263")
        self.refused("heights", heights(self.folder / "r", CRS=feet), "metres")

    def test_a_program_that_is_absent_wrong_or_old_is_told(self):
        wrong = script(self.folder, "wrong", "echo hello\n")
        old = script(self.folder, "old", 'case "$*" in --version) echo sizeup 0.1.0;; *) exit 2;; esac\n')
        for program, word in [
            (self.folder / "absent", "is no program"), (wrong, "is not sizeup; it says: hello"), (old, "too old"),
        ]:
            set_program(program)
            # Processing itself asks whether it can run; then nothing else is tried.
            said = self.refused("heights", heights(self.folder / "r"), word if word != "is no program" else "")
            del said
        set_program(self.folder / "absent")
        algorithm = QgsApplication.processingRegistry().algorithmById("sizeup:heights")
        can, why = algorithm.canExecute()
        self.assertFalse(can)
        self.assertIn("is no program", why)
        self.assertIn("sizeup program", why)

    def test_missing_and_contradicting_parameters_are_told(self):
        for more, words in [
            ({"SURVEY_FOLDER": ""}, ["one of the two"]),
            ({"SURVEY": str(SCENE / "sizeup.toml")}, ["one of the two"]),
            ({"SURVEY_FOLDER": str(SCENE / "nowhere")}, ["is not there"]),
            ({"DTM": None}, ["terrain model, or one height"]),
            ({"GROUND": 3.0}, ["one of the two"]),
            ({"PRIOR_FILES": ""}, ["{stem}"]),
            ({"OFFSET": "1,2"}, ["three numbers"]),
            ({"MORE": "nonsense"}, ["table.key=value"]),
            ({"MORE": "optimise.nonsense=1"}, ["nonsense"]),
        ]:
            with self.subTest(more=more):
                self.refused("heights", heights(self.folder / "r", **more), *words)
        self.refused("footprints", {**heights(self.folder / "r"), "FOOTPRINTS": None}, "where the masks are")
        self.refused("applyreviews", {"FOLDER": str(SCENE)}, "is not there")

    def test_an_error_of_the_program_is_shown_with_its_hint(self):
        said = self.refused("heights", heights(self.folder / "r", PRIOR_FILES=str(SCENE / "absent" / "{stem}.npy")), "prior")
        self.assertFalse((self.folder / "r" / "city.gpkg").exists())
        self.assertNotIn('"event"', said)

    def test_a_run_that_is_stopped_ends_its_program_and_loads_nothing(self):
        pid = self.folder / "pid"
        # Deaf to the first signal: it has to be ended the hard way.
        slow = script(
            self.folder, "slow",
            'case "$*" in *--version) echo sizeup 0.1.0; exit;; "model list --json") echo "[]"; exit;; esac\n'
            f'trap "" TERM\necho $$ > "{pid}"\n'
            "echo '{\"event\":\"stage\",\"stage\":\"heights\"}' >&2\n"
            "while true; do sleep 0.2; done\n",
        )
        from sizeup import program

        set_program(slow)
        patience, program.PATIENCE_S = program.PATIENCE_S, 0.5
        try:
            told = Told(cancel_at="Finding heights")
            try:
                answer = run("heights", heights(self.folder / "r"), told)
            except QgsProcessingException:
                answer = {}
        finally:
            program.PATIENCE_S = patience
        self.assertFalse(answer.get("GEOPACKAGE"))
        self.assertEqual(QgsProject.instance().mapLayers(), {})
        self.assertFalse(Path(f"/proc/{pid.read_text().strip()}").exists())

    def test_a_real_run_that_is_stopped_leaves_nothing_half_written(self):
        output = self.folder / "r"
        try:
            run("heights", heights(output), Told(cancel_at="Laying footprints"))
        except QgsProcessingException:
            pass
        self.assertFalse((output / "city.gpkg").exists())
        self.assertEqual(QgsProject.instance().mapLayers(), {})


class Algorithms(Case):
    """Every algorithm on the scene."""

    def test_the_survey_is_inspected_and_shown(self):
        output = self.folder / "survey"
        parameters = {key: value for key, value in heights(output).items() if not key.startswith("PRIOR")}
        answer = run("inspectsurvey", {**parameters, "MORE": ""})
        self.assertIn("oblique", answer["REPORT_TEXT"])
        self.assertTrue(Path(answer["PICTURE"]).is_file())
        names = {layer.name() for layer in QgsProject.instance().mapLayers().values()}
        self.assertEqual(names, {"camera_points", "view_axes", "image_footprints"})

    def exports(self):
        """The scene as other programs and a drone leave theirs: photos, footprints and terrain in one folder each."""
        script = ROOT / "tools" / "exports.py"
        written = subprocess.run(
            ["/usr/bin/python3", str(script), "write", str(SCENE), str(self.folder)], capture_output=True, text=True
        )
        self.assertEqual(written.returncode, 0, written.stderr)
        return [self.folder / name for name in ("odm", "metashape", "pix4d", "dji")]

    def test_a_folder_of_photos_becomes_a_city_whatever_program_it_is_of(self):
        # The depth of the scene stands in for minutes of matching.
        priors = SCENE / "priors" / "{stem}.npy"
        quick = f"prior.source=files\nprior.path='{priors}'\nprior.kind=inverse_depth\n{QUICK}"
        for folder in [*self.exports(), SCENE]:
            with self.subTest(folder=folder.name):
                QgsProject.instance().clear()
                told, output = Told(), self.folder / "Ergebnis" / folder.name
                layer = QgsVectorLayer(str(SCENE / "footprints.gpkg"), "footprints", "ogr")
                answer = run(
                    "city", {"FOLDER": str(folder), "FOOTPRINTS": layer, "MORE": quick, "OUTPUT": str(output)}, told
                )
                self.assertTrue(Path(answer["REPORT"]).parent.is_dir())
                names = [layer.name() for layer in QgsProject.instance().mapLayers().values()]
                self.assertIn("buildings_lod2", names, told.lines)
                rows = sqlite3.connect(answer["GEOPACKAGE"]).execute("SELECT count(*) FROM buildings WHERE height_m > 0")
                self.assertEqual(rows.fetchone()[0], 6, told.lines)
                self.assertTrue(any(line.startswith("Poses: ") for line in told.lines), told.lines)
                self.said_once_in_plain_words(told.lines)

    def said_once_in_plain_words(self, lines):
        """No line is there twice, but for those of stages; none names an option or a key of the settings."""
        said = [line for line in lines if len(line) > 40]
        self.assertEqual(len(said), len(set(said)), said)
        for line in said:
            # The command of each step is shown as it is.
            if line.startswith("sizeup "):
                continue
            self.assertIsNone(re.search(r"(^|\s)--[a-z]|\[[a-z]+(\.[a-z]+)?\]|geoid_offset|`sizeup", line), line)

    def test_what_a_folder_lacks_is_said_once_and_how_to_get_it(self):
        folder = self.folder / "Flug"
        shutil.copytree(SCENE / "images", folder / "images")
        shutil.copytree(SCENE / "sparse", folder / "sparse")
        output = self.folder / "r"
        told = Told()
        with self.assertRaises(QgsProcessingException) as caught:
            run("city", {"FOLDER": str(folder), "OUTPUT": str(output)}, told)
        # QGIS shows the exception itself several times: it is one line, and the log has the rest.
        self.assertNotIn("\n", str(caught.exception).replace("\n".join(told.lines), ""))
        self.assertEqual(sum("no layer of polygons" in line for line in told.lines), 1, told.lines)
        said = "\n".join(told.lines)
        self.assertIn("“Offset of the poses”", said)
        self.assertIsNone(re.search(r"(^|\s)--[a-z]|\[[a-z.]+\]", re.sub("^sizeup .*", "", said, flags=re.M)), said)
        self.assertFalse((output / "city.gpkg").exists())

    def test_a_look_at_the_folder_is_the_first_step_and_others_go_on_from_it(self):
        output = self.folder / "Schritte"
        answer = run("city", {"FOLDER": str(SCENE), "LOOK": True, "OUTPUT": str(output)})
        self.assertFalse((output / "city.gpkg").exists())
        settings = answer["SETTINGS"]
        inspected = run("inspectsurvey", {"SETTINGS": settings, "OUTPUT": str(self.folder / "survey"), "LOAD": False})
        self.assertIn("oblique", inspected["REPORT_TEXT"])
        priors = SCENE / "priors" / "{stem}.npy"
        quick = f"prior.source=files\nprior.path='{priors}'\nprior.kind=inverse_depth\n{QUICK}"
        city = run("heights", {"SETTINGS": settings, "MORE": quick, "OUTPUT": str(output)})
        self.assertTrue(Path(city["CITYJSON"]).is_file())

    def test_footprints_are_found_in_masks(self):
        output = self.folder / "footprints"
        parameters = {
            key: value for key, value in heights(output).items() if not key.startswith(("PRIOR", "FOOT"))
        }
        told = Told()
        answer = run("footprints", {
            **parameters, "MASKS": str(SCENE / "masks" / "{stem}.png"), "MASK_KIND": 0, "CADASTRE": footprints(),
            "CADASTRE_ID": "id", "MORE": "survey.accept_unsound=true",
        }, told)
        self.assertTrue(Path(answer["FOOTPRINTS"]).is_file(), told.lines)
        layers = {layer.name(): layer for layer in QgsProject.instance().mapLayers().values()}
        self.assertIn("footprints", layers)
        self.assertGreaterEqual(layers["footprints"].featureCount(), 4)
        self.assertEqual(layers["footprints"].renderer().type(), "RuleRenderer")

    def test_heights_are_found_loaded_styled_and_reviewed(self):
        output = self.folder / "Stadt ü"
        told = Told()
        answer = run("heights", heights(output, MORE=WITH_PAGE), told)
        self.assertTrue(all(Path(answer[name]).is_file() for name in ("GEOPACKAGE", "CITYJSON", "REPORT")))
        # One line for each stage, some with the time left.
        for line in ("Reading the survey", "Laying footprints on the ground", "Finding heights", "Writing the results"):
            self.assertEqual(sum(told_line.startswith(line) for told_line in told.lines), 1, told.lines)
        self.assertEqual((told.percents, told.percents[-1]), (sorted(told.percents), 100.0))
        group = QgsProject.instance().layerTreeRoot().findGroup("Stadt ü")
        names = [node.name() for node in group.findLayers()]
        self.assertEqual(names, ["qa_issues", "cameras", "buildings", "buildings_lod1", "buildings_lod13", "buildings_lod2"])
        buildings = group.findLayers()[2].layer()
        self.assertEqual((buildings.featureCount(), buildings.renderer().type()), (6, "RuleRenderer"))
        # The panel.
        from sizeup.review.dock import ALL, OPEN, ReviewDock
        from sizeup.review.reviews import CONFIRMED, CORRECTED, WRONG

        interface = Interface()
        dock = ReviewDock(interface)
        dock.resize(QSize(420, 760))
        dock.which.setCurrentIndex(ALL)
        self.assertEqual(dock.list.count(), 6)
        self.assertTrue(dock.photo.has_photo)
        self.assertIn("m", dock.title.text())
        # A photo that cuts the building off comes after those that show all of it, however large it is there.
        city, building = dock._city, next(b for b in dock._shown if len(dock._city.views_of(b)) > 1)
        largest = city.views_of(building)[0]
        middle = building.footprint.pointOnSurface().asPoint()
        x, _ = largest.pixel((middle.x(), middle.y(), building.ground_z_m))
        city.views[largest.name] = replace(largest, width_px=int(x) + 1)
        self.assertEqual(city.views_of(building)[-1].name, largest.name)
        city.views[largest.name] = largest
        self.assertEqual(city.views_of(building)[0].name, largest.name)
        picture = dock.grab()
        self.assertTrue(picture.save(str(PICTURES / "qgis-review.png")))
        first, second, third = (building.id for building in dock._shown[:3])
        dock.note.setText("Höhe stimmt")
        dock.author.setText("Änne")
        dock.decide(CONFIRMED)
        self.assertEqual(dock.building.id, second)
        dock.height.setValue(12.34)
        dock.decide(CORRECTED)
        dock.decide(WRONG)
        dock.go_to(0)
        self.assertEqual(dock.note.text(), "Höhe stimmt")
        dock.decide(WRONG)
        dock.go_to(0)
        dock.take_back()
        dock.go_to([b.id for b in dock._shown].index(first))
        dock.decide(CONFIRMED)
        dock.which.setCurrentIndex(OPEN)
        self.assertNotIn(first, [building.id for building in dock._shown])
        kept = json.loads((output / "reviews.geojson").read_text(encoding="utf-8"))
        decided = {f["properties"]["building_id"]: f["properties"] for f in kept["features"]}
        self.assertEqual({key: value["decision"] for key, value in decided.items()}, {
            first: "confirmed", second: "corrected", third: "wrong",
        })
        self.assertEqual((decided[second]["height_m"], decided[first]["author"]), (12.34, "Änne"))
        self.assertAlmostEqual(kept["features"][0]["geometry"]["coordinates"][0], 9.9, delta=1.5)
        # Into the result, which is loaded: it is written again and replaced, under the eyes of the panel.
        dock.which.setCurrentIndex(ALL)
        run("applyreviews", {"FOLDER": str(output)})
        self.assertEqual(dock.list.count(), 6)
        self.assertEqual({b.id: b.status for b in dock._shown}[second], "reviewed")
        self.assertEqual(len(QgsProject.instance().mapLayers()), 6)
        self.assert_reviewed(output, first, second, third)
        # And they outlive a whole run.
        run("heights", heights(output, MORE=WITH_PAGE))
        self.assert_reviewed(output, first, second, third)
        dock.disconnect_all()
        dock.deleteLater()
        layers = QgsProject.instance().mapLayers().values()
        self.assertEqual(sorted(layer.name() for layer in layers), sorted(names))

    def assert_reviewed(self, output, confirmed, corrected, wrong):
        rows = sqlite3.connect(output / "city.gpkg").execute("SELECT id, status, height_m, reasons FROM buildings")
        found = {row[0]: row[1:] for row in rows}
        self.assertEqual((found[confirmed][0], found[confirmed][2]), ("reviewed", "reviewed"))
        self.assertEqual(found[corrected], ("reviewed", 12.34, "reviewed"))
        self.assertEqual(found[wrong], ("unknown", None, "reviewed_wrong"))

    def test_a_city_is_validated_and_exported(self):
        output = self.folder / "city"
        answer = run("heights", heights(output, LOAD=False))
        self.assertEqual(QgsProject.instance().mapLayers(), {})
        valid = run("validate", {"INPUT": answer["CITYJSON"], "FAULTS": "TEMPORARY_OUTPUT"})
        self.assertEqual((valid["VALID"], valid["N_FAULTS"], valid["N_GEOMETRIES"]), (True, 0, 18))
        # One that is spoilt: a block turned inside out.
        city = json.loads(Path(answer["CITYJSON"]).read_text(encoding="utf-8"))
        for item in city["CityObjects"].values():
            for geometry in item.get("geometry", []):
                if geometry["type"] == "Solid":
                    geometry["boundaries"] = [[[ring[::-1] for ring in face] for face in geometry["boundaries"][0]]]
        spoilt = self.folder / "verdreht.city.json"
        spoilt.write_text(json.dumps(city), encoding="utf-8")
        told = run("validate", {"INPUT": str(spoilt), "FAULTS": "TEMPORARY_OUTPUT"})
        self.assertFalse(told["VALID"])
        layer = told["FAULTS"]
        self.assertGreater(layer.featureCount(), 0)
        self.assertEqual(layer.crs().authid(), CRS)
        for form, name, more in [
            (1, "stadt.city.jsonl", {}), (2, "stadt", {"LOAD": True}), (3, "stadt.fgb", {}), (4, "kacheln", {"GEOID": 45.5}),
        ]:
            made = run("export", {"INPUT": answer["CITYJSON"], "FORMAT": form, "OUTPUT": str(self.folder / name), **more})
            self.assertTrue(Path(made["OUTPUT"]).exists(), made)
        self.assertTrue((self.folder / "stadt.gpkg").is_file())
        self.assertIn("buildings", {layer.name() for layer in QgsProject.instance().mapLayers().values()})
        again = {"INPUT": answer["CITYJSON"], "FORMAT": 2, "OUTPUT": str(self.folder / "stadt.gpkg")}
        self.refused("export", again, "is open in this project")

    def test_what_changed_between_two_results_is_told_and_loaded(self):
        for name, ids in [("before", ("b001", "b002", "b003", "b004")), ("after", ("b001", "b002", "b003", "b004", "b005"))]:
            layer = footprints()
            layer.setSubsetString(f"\"id\" IN {ids}")
            run("heights", heights(self.folder / name, FOOTPRINTS=layer, LOAD=False))
        told, output = Told(), self.folder / "Änderungen"
        cities = {"OLD": str(self.folder / "before" / "city.gpkg"), "NEW": str(self.folder / "after" / "city.gpkg")}
        answer = run("changes", {**cities, "OUTPUT": str(output)}, told)
        layers = QgsProject.instance().mapLayersByName("changes")
        self.assertEqual(len(layers), 1)
        rows = {feature["new_id"]: feature for feature in layers[0].getFeatures()}
        self.assertEqual((len(rows), rows["b001"]["old_id"]), (5, "b001"))
        self.assertIn(rows["b005"]["class"], ("new", "outside"))
        self.assertIn("old result", rows["b005"]["explanation"])
        changed = [row for row in rows.values() if row["class"] in ("new", "gone", "raised", "lowered", "footprint_changed")]
        self.assertEqual(answer["N_CHANGED"], len(changed))
        labels = [rule.label() for rule in layers[0].renderer().rootRule().children()]
        self.assertIn("raised", labels)
        self.assertTrue(any("same" in line for line in told.lines), told.lines)
        self.refused("changes", {**cities, "NEW": cities["OLD"], "OUTPUT": str(output)}, "same file")

    def test_results_may_go_to_a_temporary_folder(self):
        answer = run("heights", heights("TEMPORARY_OUTPUT", LOAD=False))
        self.assertTrue(Path(answer["GEOPACKAGE"]).is_file())
        self.assertTrue((Path(answer["OUTPUT"]) / "input" / "sizeup.toml").is_file())
        self.assertNotIn("TEMPORARY", answer["OUTPUT"])

    def test_the_map_goes_to_a_result_that_is_loaded(self):
        import qgis.utils

        interface = Interface()
        canvas = interface.mapCanvas()
        canvas.setDestinationCrs(QgsCoordinateReferenceSystem("EPSG:3857"))
        canvas.setExtent(QgsRectangle(0, 0, 10, 10))
        before, qgis.utils.iface = qgis.utils.iface, interface
        try:
            answer = run("heights", heights(self.folder / "r"))
        finally:
            qgis.utils.iface = before
        layer = QgsVectorLayer(f"{answer['GEOPACKAGE']}|layername=buildings", "buildings", "ogr")
        there = canvas.mapSettings().layerExtentToOutputExtent(layer, layer.extent())
        self.assertTrue(canvas.extent().contains(there))
        self.assertLess(canvas.extent().height(), 2.5 * max(there.height(), there.width()))

    def test_the_toolbar_has_the_way_in_and_the_menu_all(self):
        from sizeup.plugin import SizeupPlugin

        class Window(Interface):
            def __init__(self):
                super().__init__()
                self.menu, self.bar = [], []

            def addPluginToMenu(self, _, action):
                self.menu.append(action)

            def addToolBarIcon(self, action):
                self.bar.append(action)

            def removePluginMenu(self, _, action):
                self.menu.remove(action)

            def removeToolBarIcon(self, action):
                self.bar = [one for one in self.bar if one is not action]

        window = Window()
        plugin = SizeupPlugin(window)
        # The provider is there already.
        plugin.initProcessing = lambda: None
        plugin.initGui()
        self.assertEqual([len(window.menu), [action.text() for action in window.bar]], [3, ["City from a folder of photos…"]])
        self.assertFalse(window.bar[0].icon().isNull())
        plugin.unload()
        self.assertEqual((window.menu, window.bar), ([], []))

    def test_the_profiles_of_networks_are_those_of_the_program(self):
        said = subprocess.run([PROGRAM, "model", "list"], capture_output=True, text=True, check=True).stdout
        algorithm = QgsApplication.processingRegistry().algorithmById("sizeup:heights").create()
        options = algorithm.parameterDefinition("PROFILE").options()
        self.assertTrue({"moge", "vggt", "map-anything", "depth-pro"} <= set(options), options)
        self.assertTrue(all(re.search(rf"^{option}\b", said, re.M) for option in options), options)
        set_program(self.folder / "absent")
        algorithm = QgsApplication.processingRegistry().algorithmById("sizeup:heights").create()
        self.assertEqual(algorithm.parameterDefinition("PROFILE").options(), [])

    def test_all_algorithms_have_help_and_an_icon(self):
        provider = QgsApplication.processingRegistry().providerById("sizeup")
        names = sorted(algorithm.name() for algorithm in provider.algorithms())
        self.assertEqual(names, [
            "applyreviews", "changes", "city", "export", "footprints", "heights", "inspectsurvey", "validate",
        ])
        for algorithm in provider.algorithms():
            self.assertGreater(len(algorithm.shortHelpString()), 100)
            self.assertFalse(algorithm.icon().isNull())
            for parameter in algorithm.parameterDefinitions():
                self.assertTrue(parameter.description())


class Process(Case):
    """The plugin as `qgis_process` finds it, in a profile of its own."""

    def test_qgis_process_lists_and_runs_it(self):
        # Debian's wrapper of 3.22 passes an option that the program does not know.
        process = shutil.which("qgis_process.bin") or shutil.which("qgis_process")
        if process is None:
            self.skipTest("no qgis_process")
        profile = self.folder / "profile"
        settings = profile / "profiles" / "default" / "QGIS"
        settings.mkdir(parents=True)
        (settings / "QGIS3.ini").write_text("[PythonPlugins]\nsizeup=true\nprocessing=true\n", encoding="utf-8")
        beside = script(self.folder, "sizeup", f'exec "{PROGRAM}" "$@"\n')
        environment = {
            **os.environ, "QGIS_CUSTOM_CONFIG_PATH": str(profile), "QGIS_PLUGINPATH": str(ROOT / "qgis"),
            "QT_QPA_PLATFORM": "offscreen", "PATH": f"{beside.parent}:{os.environ['PATH']}",
        }

        def call(*arguments):
            called = subprocess.run([process, *arguments], env=environment, capture_output=True, text=True, timeout=300)
            return called.stdout + called.stderr

        self.assertIn("sizeup:heights", call("list"))
        self.assertIn("FOOTPRINTS", call("help", "sizeup:heights"))
        more = [f"{key}={value}" for key, value in heights(self.folder / "r").items() if isinstance(value, (str, int))]
        more += [f"FOOTPRINTS={SCENE / 'footprints.gpkg'}", f"CRS={CRS}"]
        said = call("run", "sizeup:heights", "--", *more)
        self.assertTrue((self.folder / "r" / "city.gpkg").is_file(), said)
        valid = call("run", "sizeup:validate", "--", f"INPUT={self.folder / 'r' / 'city.city.json'}")
        self.assertIn("VALID:\ttrue", valid)


def main():
    global SCENE, PROGRAM, PICTURES
    if len(sys.argv) < 4:
        raise SystemExit(__doc__)
    SCENE, PROGRAM, PICTURES = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])
    application = QgsApplication([], True)
    application.initQgis()
    from processing.core.Processing import Processing

    Processing.initialize()
    from sizeup.provider import SizeupProvider

    provider = SizeupProvider()
    QgsApplication.processingRegistry().addProvider(provider)
    start = time.monotonic()
    outcome = unittest.main(argv=[sys.argv[0], *sys.argv[4:]], exit=False, verbosity=2).result
    print(f"{outcome.testsRun} tests in {time.monotonic() - start:.0f} s")
    QgsProject.instance().clear()
    shutil.rmtree(PROFILE, ignore_errors=True)
    sys.stdout.flush()
    # QGIS's own end crashes now and then with layers of Python's still around; what was found is said.
    os._exit(0 if outcome.wasSuccessful() else 1)


if __name__ == "__main__":
    main()
