"""Heights of buildings from oblique aerial photos: the program `sizeup`, its results, and its method on arrays.

>>> import sizeup
>>> project = sizeup.init("flight")                       # as `sizeup init flight`: writes sizeup.toml
>>> city = sizeup.run(project.config)                     # as `sizeup run sizeup.toml`
>>> city["house 7"].height_m
>>> city.to_geodataframe()[["id", "height_m", "status"]]  # with geopandas
>>> city.export("city.gml")                               # as `sizeup export`
>>> sizeup.read("result").buildings[0].height_m           # of an earlier run
>>> heights = sizeup.estimate_heights(footprints, views, ground_m=48.0)   # arrays in memory

Every error is a :class:`SizeupError` with a ``message`` and, where it is known what helps, a ``hint``.
"""

from ._arrays import Camera, Grid, Height, Part, Pose, View, estimate_heights
from ._commands import Missing, Project, changes, evaluate, init, run
from ._errors import ConfigurationError, InputError, RunError, SizeupError
from ._export import export
from ._native import version as _version
from ._program import Progress
from ._results import Building, City, Solid, read

__version__: str = _version()

__all__ = [
    "Building",
    "Camera",
    "City",
    "ConfigurationError",
    "Grid",
    "Height",
    "InputError",
    "Missing",
    "Part",
    "Pose",
    "Progress",
    "Project",
    "RunError",
    "SizeupError",
    "Solid",
    "View",
    "changes",
    "estimate_heights",
    "evaluate",
    "export",
    "init",
    "read",
    "run",
]
