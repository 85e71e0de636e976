"""Words that people read, in their language where there is a translation."""

from qgis.PyQt.QtCore import QCoreApplication

# Where `pylupdate5` files what is outside of classes.
OUTSIDE = "@default"


class Speaks:
    """What shows text; `tr` is what `pylupdate5` looks for. It files words under the class that they are written in."""

    @classmethod
    def tr(cls, text: str) -> str:
        """The text in the language of QGIS."""
        for context in [*(one.__name__ for one in cls.__mro__), OUTSIDE]:
            translated = QCoreApplication.translate(context, text)
            if translated != text:
                return translated
        return text
