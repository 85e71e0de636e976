"""Heights of buildings from oblique aerial photos, in QGIS: a door to the program `sizeup`."""


def classFactory(iface):  # noqa: N802, the name is QGIS's
    """The plugin; QGIS calls this when it loads it."""
    from .plugin import SizeupPlugin

    return SizeupPlugin(iface)
