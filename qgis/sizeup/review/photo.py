"""A photo with a building's block drawn over it."""

from typing import Iterable, List, Optional, Sequence, Tuple

from osgeo import gdal
from qgis.PyQt.QtCore import QPointF, QRectF, Qt
from qgis.PyQt.QtGui import QColor, QImage, QPainter, QPainterPath, QPen
from qgis.PyQt.QtWidgets import QSizePolicy, QWidget

from ..words import Speaks
from .camera import Pixel, View
from .city import Building

# How much around the block is shown, in its own sizes.
MARGIN = 0.7
# Least side of what is shown, pixels of the photo.
LEAST_PX = 80.0
# Longest side that is read; screens show no more.
LONGEST_PX = 1600
ROOF, WALL, GROUND = QColor("#ffb000"), QColor(255, 176, 0, 150), QColor("#64d2ff")
ZOOM_STEP, ZOOM_MOST = 1.25, 12.0


class Block:
    """A building's block in a photo: rings of pixels on the ground and at the roof."""

    def __init__(self, view: View, building: Building, height_m: Optional[float]) -> None:
        ground, base = building.ground_z_m, building.base_z_m
        self.base: List[List[Pixel]] = []
        self.roof: List[List[Pixel]] = []
        if ground is None:
            return
        self.base = _rings(view, building, ground if base is None else base)
        if height_m is not None:
            self.roof = _rings(view, building, ground + height_m)

    def frame(self, view: View, aspect: float) -> Optional[QRectF]:
        """The part of the photo that shows the block and what is around it, so many times as wide as high."""
        points = [point for ring in self.base + self.roof for point in ring]
        if not points:
            return None
        xs, ys = [x for x, _ in points], [y for _, y in points]
        side = max(max(xs) - min(xs), max(ys) - min(ys), LEAST_PX / (1 + 2 * MARGIN)) * (1 + 2 * MARGIN)
        x, y = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
        width, height = side * max(aspect, 1.0), side * max(1.0 / aspect, 1.0)
        frame = QRectF(x - width / 2, y - height / 2, width, height)
        return frame.intersected(QRectF(0, 0, view.width_px, view.height_px))


def _rings(view: View, building: Building, z_m: float) -> List[List[Pixel]]:
    rings = []
    for ring in building.rings:
        pixels = [view.pixel((x, y, z_m)) for x, y in ring]
        if all(pixel is not None for pixel in pixels):
            rings.append(pixels)
    return rings


def read_part(view: View, frame: QRectF) -> Tuple[Optional[QImage], str]:
    """A part of a photo (pixels of the survey's camera), reduced to what a screen shows; None with why it cannot be read."""
    try:
        data = gdal.Open(str(view.image))
    except RuntimeError as error:
        return None, str(error)
    if data is None:
        return None, gdal.GetLastErrorMsg() or f"{view.image}: cannot be read"
    # A photo may be stored smaller than the survey says.
    sx, sy = data.RasterXSize / view.width_px, data.RasterYSize / view.height_px
    x, y = int(frame.left() * sx), int(frame.top() * sy)
    width = max(1, min(int(frame.width() * sx), data.RasterXSize - x))
    height = max(1, min(int(frame.height() * sy), data.RasterYSize - y))
    scale = min(1.0, LONGEST_PX / max(width, height))
    columns, rows = max(1, int(width * scale)), max(1, int(height * scale))
    bands = [1, 2, 3] if data.RasterCount >= 3 else [1, 1, 1]
    parts = []
    for band in bands:
        part = data.GetRasterBand(band).ReadRaster(
            x, y, width, height, columns, rows, gdal.GDT_Byte, resample_alg=gdal.GRIORA_Average
        )
        if part is None:
            return None, gdal.GetLastErrorMsg() or f"{view.image}: cannot be read"
        parts.append(part)
    pixels = bytearray(columns * rows * 3)
    for i, part in enumerate(parts):
        pixels[i::3] = part
    return QImage(bytes(pixels), columns, rows, columns * 3, QImage.Format_RGB888).copy(), ""


class PhotoView(QWidget, Speaks):
    """Shows the part of a photo around a building, with its block; the wheel zooms, dragging moves."""

    def __init__(self, parent: Optional[QWidget] = None) -> None:
        super().__init__(parent)
        self.setMinimumSize(240, 200)
        self.setSizePolicy(QSizePolicy.Expanding, QSizePolicy.Expanding)
        self._image: Optional[QImage] = None
        self._frame = QRectF()
        self._block: Optional[Block] = None
        self._words = self.tr("No photo")
        self._shown: Optional[Tuple[View, Building]] = None
        self._zoom, self._shift, self._grip = 1.0, QPointF(), None

    def show_view(self, view: Optional[View], building: Building, height_m: Optional[float], words: str) -> None:
        """Another photo or building."""
        self._zoom, self._shift = 1.0, QPointF()
        self._image, self._block, self._words, self._shown = None, None, words, None
        if view is not None:
            self._shown, self._block = (view, building), Block(view, building, height_m)
            self._read()
        self.update()

    def _read(self) -> None:
        """Reads the part of the photo that fits the widget."""
        view = self._shown[0]
        frame = self._block.frame(view, self.width() / max(1, self.height()))
        if frame is not None and not frame.isEmpty():
            self._frame = frame
            self._image, error = read_part(view, frame)
            self._words = error or self._words

    def resizeEvent(self, event) -> None:  # noqa: N802, the name is Qt's
        if self._image is not None and event.oldSize() != event.size():
            self._read()

    def show_height(self, view: Optional[View], building: Building, height_m: Optional[float]) -> None:
        """The same photo with the block at another height."""
        if view is not None and self._image is not None:
            self._block = Block(view, building, height_m)
            self.update()

    @property
    def has_photo(self) -> bool:
        """Whether a photo is shown."""
        return self._image is not None

    def paintEvent(self, event) -> None:  # noqa: N802, the name is Qt's
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor("#26262e"))
        painter.setPen(QColor("#d8d8de"))
        if self._image is None:
            painter.drawText(self.rect().adjusted(12, 12, -12, -12), Qt.AlignCenter | Qt.TextWordWrap, self._words)
            return
        target = self._target()
        painter.setRenderHint(QPainter.SmoothPixmapTransform)
        painter.drawImage(target, self._image)
        painter.setRenderHint(QPainter.Antialiasing)
        self._paint_block(painter, target)
        painter.setPen(QColor("white"))
        band = QRectF(0, self.height() - 20, self.width(), 20)
        painter.fillRect(band, QColor(20, 20, 26, 170))
        painter.drawText(band.adjusted(6, 0, -6, 0), Qt.AlignVCenter | Qt.AlignLeft, self._words)

    def _target(self) -> QRectF:
        """Where the part of the photo lies in the widget."""
        scale = min(self.width() / self._frame.width(), self.height() / self._frame.height()) * self._zoom
        width, height = self._frame.width() * scale, self._frame.height() * scale
        left, top = (self.width() - width) / 2 + self._shift.x(), (self.height() - height) / 2 + self._shift.y()
        return QRectF(left, top, width, height)

    def _paint_block(self, painter: QPainter, target: QRectF) -> None:
        scale = target.width() / self._frame.width()

        def at(pixel: Pixel) -> QPointF:
            return QPointF(
                target.left() + (pixel[0] - self._frame.left()) * scale, target.top() + (pixel[1] - self._frame.top()) * scale
            )

        pairs = zip(self._block.base, self._block.roof)
        for base, roof in pairs:
            painter.setPen(QPen(WALL, 1.2))
            for low, high in zip(base, roof):
                painter.drawLine(at(low), at(high))
        _draw(painter, self._block.base, at, QPen(GROUND, 1.4, Qt.DashLine))
        _draw(painter, self._block.roof, at, QPen(ROOF, 2.2))

    def wheelEvent(self, event) -> None:  # noqa: N802, the name is Qt's
        factor = ZOOM_STEP if event.angleDelta().y() > 0 else 1 / ZOOM_STEP
        zoom = min(max(self._zoom * factor, 1.0), ZOOM_MOST)
        self._shift = self._shift * (zoom / self._zoom) if zoom > 1.0 else QPointF()
        self._zoom = zoom
        self.update()

    def mousePressEvent(self, event) -> None:  # noqa: N802, the name is Qt's
        self._grip = event.pos()

    def mouseMoveEvent(self, event) -> None:  # noqa: N802, the name is Qt's
        if self._grip is not None:
            self._shift += QPointF(event.pos() - self._grip)
            self._grip = event.pos()
            self.update()

    def mouseReleaseEvent(self, event) -> None:  # noqa: N802, the name is Qt's
        self._grip = None


def _draw(painter: QPainter, rings: Iterable[Sequence[Pixel]], at, pen: QPen) -> None:
    painter.setPen(pen)
    path = QPainterPath()
    for ring in rings:
        path.moveTo(at(ring[0]))
        for pixel in ring[1:]:
            path.lineTo(at(pixel))
        path.closeSubpath()
    painter.drawPath(path)
