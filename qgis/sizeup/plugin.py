"""The plugin: a provider of algorithms, and the review panel."""

from pathlib import Path
from typing import Optional

from qgis.core import QgsApplication, QgsSettings
from qgis.PyQt.QtCore import QCoreApplication, Qt, QTranslator
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QAction

from .provider import ICON, SizeupProvider
from .words import Speaks

MENU = "sizeup"


class SizeupPlugin(Speaks):
    """What QGIS loads."""

    def __init__(self, iface) -> None:
        self.iface = iface
        self.provider: Optional[SizeupProvider] = None
        self.dock = None
        self.actions = []
        self._translator = _translator()

    def initProcessing(self) -> None:  # noqa: N802, the name is QGIS's
        """The algorithms; all there is without windows, as in `qgis_process`."""
        self.provider = SizeupProvider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self) -> None:  # noqa: N802, the name is QGIS's
        """The algorithms, and what is in the menu."""
        self.initProcessing()
        city = self._add(self.tr("City from a folder of photos…"), lambda: _open("sizeup:city"))
        # The way in; the other two are in the menu.
        self.iface.addToolBarIcon(city)
        self._add(self.tr("Estimate heights…"), lambda: _open("sizeup:heights"))
        self._add(self.tr("Review buildings"), self.show_review)

    def _add(self, words: str, run) -> QAction:
        action = QAction(QIcon(str(ICON)), words, self.iface.mainWindow())
        action.triggered.connect(lambda _: run())
        self.iface.addPluginToMenu(MENU, action)
        self.actions.append(action)
        return action

    def show_review(self) -> None:
        """Opens the review panel, or brings it to the front."""
        if self.dock is None:
            from .review.dock import ReviewDock

            self.dock = ReviewDock(self.iface, self.iface.mainWindow())
            self.iface.addDockWidget(Qt.RightDockWidgetArea, self.dock)
        self.dock.show()
        self.dock.raise_()

    def unload(self) -> None:
        """Takes everything away again."""
        for action in self.actions:
            self.iface.removePluginMenu(MENU, action)
            self.iface.removeToolBarIcon(action)
        self.actions.clear()
        if self.dock is not None:
            self.dock.disconnect_all()
            self.iface.removeDockWidget(self.dock)
            self.dock.deleteLater()
            self.dock = None
        if self.provider is not None:
            QgsApplication.processingRegistry().removeProvider(self.provider)
            self.provider = None
        if self._translator is not None:
            QCoreApplication.removeTranslator(self._translator)


def _translator() -> Optional[QTranslator]:
    """The words of the user's language, where the plugin has them in `i18n/`."""
    language = str(QgsSettings().value("locale/userLocale", "en"))[:2]
    path = Path(__file__).parent / "i18n" / f"sizeup_{language}.qm"
    if not path.is_file():
        return None
    translator = QTranslator()
    translator.load(str(path))
    QCoreApplication.installTranslator(translator)
    return translator


def _open(algorithm: str) -> None:
    import processing

    processing.execAlgorithmDialog(algorithm)
