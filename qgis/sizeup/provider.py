"""The provider of algorithms in the Processing toolbox."""

from pathlib import Path

from qgis.core import QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from . import settings
from .algorithms import ALGORITHMS

ICON = Path(__file__).parent / "icon.svg"


class SizeupProvider(QgsProcessingProvider):
    """Algorithms that run the program `sizeup`."""

    def load(self) -> bool:
        settings.register(self.name(), self.icon())
        self.refreshAlgorithms()
        return True

    def unload(self) -> None:
        settings.unregister()

    def loadAlgorithms(self) -> None:  # noqa: N802, the name is QGIS's
        for algorithm in ALGORITHMS:
            self.addAlgorithm(algorithm())

    def id(self) -> str:
        return "sizeup"

    def name(self) -> str:
        return "sizeup"

    def longName(self) -> str:  # noqa: N802, the name is QGIS's
        return "sizeup: building heights from aerial photos"

    def icon(self) -> QIcon:
        return QIcon(str(ICON))

    def svgIconPath(self) -> str:  # noqa: N802, the name is QGIS's
        return str(ICON)
