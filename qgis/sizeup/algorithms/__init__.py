"""The algorithms, one module each."""

from .changes import CompareResults
from .city import CityFromFolder
from .export import ExportCity
from .footprints import FindFootprints
from .heights import EstimateHeights
from .inspect import InspectSurvey
from .review import ApplyReviews
from .validate import ValidateCity

ALGORITHMS = (
    CityFromFolder, InspectSurvey, FindFootprints, EstimateHeights, ApplyReviews, CompareResults, ValidateCity, ExportCity,
)
