"""The panel that goes through doubtful buildings: why, the photos with the block, and a decision."""

from datetime import date
from typing import List, Optional

from qgis.core import QgsApplication, QgsProject, QgsRectangle, QgsSettings, QgsVectorLayer
from qgis.PyQt.QtCore import Qt
from qgis.PyQt.QtGui import QKeySequence
from qgis.PyQt.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QDockWidget,
    QDoubleSpinBox,
    QFormLayout,
    QFrame,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QListWidget,
    QPushButton,
    QScrollArea,
    QShortcut,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from ..results import file_of
from ..words import Speaks
from .camera import SurveyError, View
from .city import TO_LOOK_AT, Building, City, is_result
from .photo import PhotoView
from .reviews import CONFIRMED, CORRECTED, FILE_NAME, WRONG, Review, Reviews, ReviewsError

# Highest building that can be entered, metres.
HIGHEST_M = 1000.0
# What is tried first for a building without a height, metres.
FIRST_HEIGHT_M = 6.0
# Least and greatest steps of the height, metres.
STEP_M = 0.1
# How much of the map is around a building, in its own sizes.
MAP_MARGIN = 6.0
DOUBTFUL, OPEN, ALL = range(3)
AUTHOR = "sizeup/author"


class ReviewDock(QDockWidget, Speaks):
    """Buildings of a loaded result, one after the other."""

    def __init__(self, iface, parent: Optional[QWidget] = None) -> None:
        super().__init__(Speaks.tr("Review buildings"), parent)
        self.setObjectName("sizeupReview")
        self._iface = iface
        self._city: Optional[City] = None
        self._reviews: Optional[Reviews] = None
        self._shown: List[Building] = []
        self._at = -1
        self._views: List[View] = []
        self._view_at = 0
        self._is_filling = False
        self._build()
        project = QgsProject.instance()
        project.layersAdded.connect(self.find_results)
        project.layersRemoved.connect(self.find_results)
        self.find_results()

    # --- The widgets ---

    def _build(self) -> None:
        body = QWidget(self)
        column = QVBoxLayout(body)
        column.setContentsMargins(6, 6, 6, 6)
        self.results = QComboBox(body)
        self.results.setToolTip(self.tr("The result: buildings of a city.gpkg in the project"))
        self.results.currentIndexChanged.connect(self._open)
        self.which = QComboBox(body)
        self.which.addItems([
            self.tr("doubtful and without a height"), self.tr("the same, without a decision yet"), self.tr("all buildings"),
        ])
        self.which.currentIndexChanged.connect(lambda _: self._list())
        form = QFormLayout()
        form.addRow(self.tr("Result"), self.results)
        form.addRow(self.tr("Show"), self.which)
        column.addLayout(form)
        self.list = QListWidget(body)
        self.list.setSelectionMode(QAbstractItemView.SingleSelection)
        self.list.setFixedHeight(84)
        self.list.currentRowChanged.connect(self.go_to)
        column.addWidget(self.list)
        column.addLayout(self._steps(body))
        self.title = QLabel(body)
        self.title.setTextInteractionFlags(Qt.TextSelectableByMouse)
        self.why = QLabel(body)
        self.why.setWordWrap(True)
        column.addWidget(self.title)
        column.addWidget(self.why)
        self.photo = PhotoView(body)
        column.addWidget(self.photo, 1)
        column.addLayout(self._photo_steps(body))
        column.addLayout(self._decision(body))
        self.state = QLabel(body)
        self.state.setWordWrap(True)
        column.addWidget(self.state)
        self.apply = QPushButton(self.tr("Apply to the result…"), body)
        self.apply.setToolTip(self.tr("Writes the result again with the decisions; heights are not computed again"))
        self.apply.clicked.connect(self._apply)
        column.addWidget(self.apply)
        # Low screens scroll; nothing lies over anything else.
        scroll = QScrollArea(self)
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QFrame.NoFrame)
        scroll.setWidget(body)
        self.setWidget(scroll)

    def _steps(self, body: QWidget) -> QHBoxLayout:
        row = QHBoxLayout()
        self.previous = _button(body, Qt.LeftArrow, self.tr("Building before (Page Up)"), lambda: self.go_to(self._at - 1))
        self.next = _button(body, Qt.RightArrow, self.tr("Next building (Page Down)"), lambda: self.go_to(self._at + 1))
        for key, button in ((Qt.Key_PageUp, self.previous), (Qt.Key_PageDown, self.next)):
            QShortcut(QKeySequence(key), body, button.click, context=Qt.WidgetWithChildrenShortcut)
        self.count = QLabel(body)
        self.count.setAlignment(Qt.AlignCenter)
        row.addWidget(self.previous)
        row.addWidget(self.count, 1)
        row.addWidget(self.next)
        return row

    def _photo_steps(self, body: QWidget) -> QHBoxLayout:
        row = QHBoxLayout()
        self.photo_before = _button(body, Qt.LeftArrow, self.tr("Photo before"), lambda: self.show_photo(self._view_at - 1))
        self.photo_next = _button(body, Qt.RightArrow, self.tr("Next photo"), lambda: self.show_photo(self._view_at + 1))
        self.photo_count = QLabel(body)
        self.photo_count.setAlignment(Qt.AlignCenter)
        row.addWidget(self.photo_before)
        row.addWidget(self.photo_count, 1)
        row.addWidget(self.photo_next)
        return row

    def _decision(self, body: QWidget) -> QVBoxLayout:
        self.height = QDoubleSpinBox(body)
        self.height.setRange(STEP_M, HIGHEST_M)
        self.height.setDecimals(2)
        self.height.setSingleStep(STEP_M)
        self.height.setSuffix(" m")
        self.height.setToolTip(self.tr("Height above the ground; the block in the photo follows"))
        self.height.valueChanged.connect(self._height_changed)
        self.note = QLineEdit(body)
        self.note.setPlaceholderText(self.tr("why, if you like"))
        self.author = QLineEdit(QgsSettings().value(AUTHOR, QgsApplication.userFullName() or ""), body)
        form = QFormLayout()
        form.addRow(self.tr("Height"), self.height)
        form.addRow(self.tr("Note"), self.note)
        form.addRow(self.tr("By"), self.author)
        self.confirm = QPushButton(self.tr("Confirm"), body)
        self.confirm.setToolTip(self.tr("The height that was found is right"))
        self.confirm.clicked.connect(lambda: self.decide(CONFIRMED))
        self.correct = QPushButton(self.tr("Correct height"), body)
        self.correct.setToolTip(self.tr("The height above is right"))
        self.correct.clicked.connect(lambda: self.decide(CORRECTED))
        self.wrong = QPushButton(self.tr("Wrong"), body)
        self.wrong.setToolTip(self.tr("The height is wrong, and the right one is not known"))
        self.wrong.clicked.connect(lambda: self.decide(WRONG))
        self.undo = QPushButton(self.tr("Undo"), body)
        self.undo.setToolTip(self.tr("Takes the decision about this building back"))
        self.undo.clicked.connect(self.take_back)
        row = QHBoxLayout()
        for button in (self.confirm, self.correct, self.wrong, self.undo):
            row.addWidget(button)
        column = QVBoxLayout()
        column.addLayout(form)
        column.addLayout(row)
        return column

    # --- The result ---

    def find_results(self, *_) -> None:
        """Lists the results of the project; the one that is open stays open if it is there."""
        before = self.results.currentData()
        layers = [layer for layer in QgsProject.instance().mapLayers().values() if is_result(layer)]
        self.results.blockSignals(True)
        self.results.clear()
        for layer in sorted(layers, key=lambda layer: layer.source()):
            self.results.addItem(_name_of(layer), layer.id())
        self.results.setCurrentIndex(max(0, self.results.findData(before)) if layers else -1)
        self.results.blockSignals(False)
        if self.results.currentData() != before or (self._city is None and layers):
            self._open()

    def _open(self, *_) -> None:
        layer = QgsProject.instance().mapLayer(self.results.currentData() or "")
        self._city, self._reviews = None, None
        self.state.clear()
        if layer is not None:
            try:
                city = City(layer)
                self._city, self._reviews = city, Reviews(city.folder / FILE_NAME)
            except (SurveyError, ReviewsError) as error:
                self._city = None
                self.state.setText(str(error))
        self._list()

    def _list(self, keep: Optional[str] = None) -> None:
        """Lists the buildings to go through, and goes to one of them."""
        buildings = self._city.buildings if self._city is not None else []
        which = self.which.currentIndex()
        if which != ALL:
            buildings = [b for b in buildings if b.status in TO_LOOK_AT or self._reviews.get(b.id) is not None]
        if which == OPEN:
            buildings = [b for b in buildings if self._reviews.get(b.id) is None]
        # Without a height first, then by how uncertain they are.
        order = {status: i for i, status in enumerate(("unknown", "doubtful", "fallback"))}
        self._shown = sorted(buildings, key=lambda b: (order.get(b.status, 9), -(b.sigma_m or 0.0), b.id))
        self.list.blockSignals(True)
        self.list.clear()
        self.list.addItems([self._entry(building) for building in self._shown])
        self.list.blockSignals(False)
        ids = [building.id for building in self._shown]
        self.go_to(ids.index(keep) if keep in ids else 0)

    def _entry(self, building: Building) -> str:
        review = self._reviews.get(building.id)
        return f"{building.id} · {self._status(building.status)}" + (f" → {self._decided(review)}" if review else "")

    def _status(self, status: str) -> str:
        return {
            "measured": self.tr("measured"), "given": self.tr("given"), "doubtful": self.tr("doubtful"),
            "fallback": self.tr("from a fallback"), "unknown": self.tr("height not known"),
            "refused": self.tr("footprint refused"), "reviewed": self.tr("reviewed"),
        }.get(status, status)

    def _decided(self, review: Review) -> str:
        if review.decision == WRONG:
            return self.tr("wrong")
        word = self.tr("confirmed") if review.decision == CONFIRMED else self.tr("corrected")
        return f"{word}: {review.height_m:.2f} m"

    # --- One building ---

    @property
    def building(self) -> Optional[Building]:
        """The building that is looked at."""
        return self._shown[self._at] if 0 <= self._at < len(self._shown) else None

    def go_to(self, at: int) -> None:
        """Shows a building: why, its photos, its place on the map."""
        self._at = min(max(at, 0), len(self._shown) - 1) if self._shown else -1
        self.list.blockSignals(True)
        self.list.setCurrentRow(self._at)
        self.list.blockSignals(False)
        building = self.building
        n = len(self._shown)
        self.count.setText(self.tr("{} of {}").format(self._at + 1, n) if n else self.tr("none"))
        self.previous.setEnabled(self._at > 0)
        self.next.setEnabled(self._at + 1 < n)
        for widget in (self.height, self.note, self.author, self.wrong, self.undo, self.correct, self.confirm):
            widget.setEnabled(building is not None)
        self.apply.setEnabled(self._reviews is not None and len(self._reviews) > 0)
        if building is None:
            self._show_nothing()
            return
        self._fill(building)
        self._views = self._city.views_of(building)
        self.show_photo(0)
        self._zoom(building)

    def _show_nothing(self) -> None:
        self.title.setText("")
        self.why.setText(
            self.tr("Load a result first: its layer “buildings”.") if self._city is None
            else self.tr("Nothing to look at: every building is measured, or has a decision.")
        )
        self._views = []
        self.photo.show_view(None, None, None, "")
        self.photo_count.setText("")

    def _fill(self, building: Building) -> None:
        review = self._reviews.get(building.id)
        height = self.tr("height not known")
        if building.height_m is not None:
            sigma = f" ± {building.sigma_m:.2f}" if building.sigma_m is not None else ""
            height = f"{building.height_m:.2f}{sigma} m"
        decided = f" → {self._decided(review)}" if review else ""
        self.title.setText(f"<b>{building.id}</b> · {height} · {self._status(building.status)}{decided}")
        self.why.setText(self._city.why(building))
        self._is_filling = True
        shown = review.height_m if review and review.height_m else building.height_m
        self.height.setValue(shown if shown is not None else FIRST_HEIGHT_M)
        self.note.setText(review.note if review else "")
        self._is_filling = False
        self.confirm.setEnabled(building.height_m is not None)
        self.undo.setEnabled(review is not None)

    def show_photo(self, at: int) -> None:
        """Shows another photo of the building."""
        building, n = self.building, len(self._views)
        self._view_at = min(max(at, 0), n - 1) if n else 0
        view = self._views[self._view_at] if n else None
        words = view.name if view else self.tr(
            "No photo of this building is at hand: the survey names no photo files, or they are not where they were."
        )
        self.photo.show_view(view, building, self.height.value(), words)
        self.photo_count.setText(self.tr("photo {} of {}").format(self._view_at + 1, n) if n else "")
        self.photo_before.setEnabled(self._view_at > 0)
        self.photo_next.setEnabled(self._view_at + 1 < n)

    def _height_changed(self, height_m: float) -> None:
        if not self._is_filling and self.building is not None and self._views:
            self.photo.show_height(self._views[self._view_at], self.building, height_m)

    def _zoom(self, building: Building) -> None:
        canvas = self._iface.mapCanvas() if self._iface is not None else None
        if canvas is None or building.footprint.isEmpty():
            return
        extent = QgsRectangle(building.extent)
        extent.scale(MAP_MARGIN)
        canvas.setExtent(canvas.mapSettings().layerExtentToOutputExtent(self._city.layer, extent))
        canvas.refresh()
        canvas.flashGeometries([building.footprint], self._city.layer.crs())

    # --- Decisions ---

    def decide(self, decision: str) -> None:
        """Keeps a decision about the building, and goes on to the next."""
        building = self.building
        if building is None:
            return
        height_m = {CONFIRMED: building.height_m, CORRECTED: round(self.height.value(), 3), WRONG: None}[decision]
        review = Review(
            building_id=building.id,
            decision=decision,
            height_m=height_m,
            sigma_m=building.sigma_m if decision == CONFIRMED else None,
            note=self.note.text().strip(),
            author=self.author.text().strip(),
            date=date.today().isoformat(),
            place=self._city.place(building),
        )
        QgsSettings().setValue(AUTHOR, review.author)
        if self._keep(lambda: self._reviews.put(review)):
            self._go_on()

    def take_back(self) -> None:
        """Takes the decision about the building back."""
        building = self.building
        if building is not None and self._keep(lambda: self._reviews.remove(building.id)):
            self._list(keep=building.id)

    def _keep(self, change) -> bool:
        try:
            change()
        except (OSError, ValueError) as error:
            self.state.setText(self.tr("The decision cannot be kept: {}").format(error))
            return False
        self.state.setText(self.tr("{} decisions in {}").format(len(self._reviews), self._reviews.path))
        return True

    def _go_on(self) -> None:
        """To the next building; where decided ones are hidden, the list moves up instead."""
        if self.which.currentIndex() == OPEN:
            following = self._shown[self._at + 1].id if self._at + 1 < len(self._shown) else None
            self._list(keep=following)
            return
        self.list.item(self._at).setText(self._entry(self.building))
        self.go_to(self._at + 1)

    def _apply(self) -> None:
        """Opens the algorithm that writes the result again."""
        import processing

        parameters = {"FOLDER": str(self._city.folder)}
        processing.execAlgorithmDialog("sizeup:applyreviews", parameters)
        self._open()

    def disconnect_all(self) -> None:
        """Lets go of the project, before the panel is taken away."""
        project = QgsProject.instance()
        project.layersAdded.disconnect(self.find_results)
        project.layersRemoved.disconnect(self.find_results)


def _name_of(layer: QgsVectorLayer) -> str:
    """What a result is called: its folder."""
    path = file_of(layer)
    return f"{path.parent.name}/{path.name}"


def _button(parent: QWidget, arrow: Qt.ArrowType, words: str, clicked) -> QToolButton:
    button = QToolButton(parent)
    button.setArrowType(arrow)
    button.setToolTip(words)
    button.clicked.connect(lambda _: clicked())
    return button
