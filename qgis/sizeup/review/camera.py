"""From places to pixels: the cameras of a survey as the program has written them. Knows nothing of QGIS.

A point p (metres, the project's CRS) is at `R p + t` in the camera's frame (x right, y down, z forward), at
`(x/z, y/z)` in the ideal image, bent by the lens, and at `(fx x + cx, fy y + cy)` in pixels; the top-left pixel's centre is
(0.5, 0.5). Lens models and their names are those of the program (OpenCV's Brown, rational and fisheye; Pix4D's series).
"""

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

Point = Sequence[float]
Pixel = Tuple[float, float]

# Samples along the radius at which a lens has to keep its sense.
RISING_CHECKS = 16


class SurveyError(Exception):
    """The cameras of a result cannot be read; the text is for people."""


@dataclass(frozen=True)
class View:
    """A photo and the camera that took it."""

    name: str
    image: Optional[Path]
    width_px: int
    height_px: int
    focal_px: Tuple[float, float]
    centre_px: Tuple[float, float]
    lens: Dict
    # Columns of the rotation, one after the other.
    rotation: Tuple[float, ...]
    translation: Tuple[float, float, float]

    def pixel(self, point: Point) -> Optional[Pixel]:
        """The pixel that shows a point; None behind the camera or beyond the lens. It may lie outside the photo."""
        r, t = self.rotation, self.translation
        x, y, z = (
            r[i] * point[0] + r[3 + i] * point[1] + r[6 + i] * point[2] + t[i] for i in range(3)
        )
        if z <= 0.0:
            return None
        bent = distort(self.lens, x / z, y / z)
        if bent is None:
            return None
        return self.focal_px[0] * bent[0] + self.centre_px[0], self.focal_px[1] * bent[1] + self.centre_px[1]

    def contains(self, pixel: Pixel) -> bool:
        """Whether a pixel lies in the photo."""
        return 0.0 <= pixel[0] <= self.width_px and 0.0 <= pixel[1] <= self.height_px


def distort(lens: Dict, x: float, y: float) -> Optional[Pixel]:
    """Where the lens bends a place of the ideal image to; None where the model has folded back."""
    model = lens.get("model", "none")
    if model == "none":
        return x, y
    k = {name: float(value) for name, value in lens.items() if name != "model"}
    if model in ("fisheye", "fisheye_series"):
        return _fisheye(model, k, x, y)
    if not _is_rising(lambda r: r * _radial(model, k, r * r), math.hypot(x, y)):
        return None
    r2 = x * x + y * y
    factor, p1, p2 = _radial(model, k, r2), k.get("p1", 0.0), k.get("p2", 0.0)
    x_d = x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    y_d = y * factor + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return x_d + k.get("skew", 0.0) * y_d, y_d


def _radial(model: str, k: Dict[str, float], r2: float) -> float:
    above = 1 + r2 * (k["k1"] + r2 * (k["k2"] + r2 * k["k3"]))
    if model == "rational":
        return above / (1 + r2 * (k["k4"] + r2 * (k["k5"] + r2 * k["k6"])))
    return above + r2**4 * k.get("k4", 0.0)


def _fisheye(model: str, k: Dict[str, float], x: float, y: float) -> Optional[Pixel]:
    powers = (2, 4, 6, 8) if model == "fisheye" else (1, 2, 3)
    names = ("k1", "k2", "k3", "k4")
    r = math.hypot(x, y)
    if r < 1e-9:
        return x, y

    def bend(theta: float) -> float:
        return theta * (1 + sum(k[name] * theta**power for name, power in zip(names, powers)))

    theta = math.atan(r)
    if not _is_rising(bend, theta):
        return None
    return x * bend(theta) / r, y * bend(theta) / r


def _is_rising(of, end: float) -> bool:
    """Whether a function rises all the way from 0."""
    values = [of(end * i / RISING_CHECKS) for i in range(RISING_CHECKS + 1)]
    return end == 0.0 or all(later > earlier for earlier, later in zip(values, values[1:]))


def read_views(result: Path) -> Dict[str, View]:
    """The photos of a result by name, from its `stages/survey.json`. Raises SurveyError."""
    path = result / "stages" / "survey.json"
    try:
        views = json.loads(path.read_text(encoding="utf-8"))["data"]["views"]
        found = [_view(view, result) for view in views]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SurveyError(f"{path} cannot be read: {error}") from error
    return {view.name: view for view in found}


def _view(view: Dict, result: Path) -> View:
    camera, pose = view["camera"], view["camera_from_map"]
    return View(
        name=view["id"],
        image=_image(view, result),
        width_px=camera["width_px"],
        height_px=camera["height_px"],
        focal_px=(camera["fx_px"], camera["fy_px"]),
        centre_px=(camera["cx_px"], camera["cy_px"]),
        lens=camera.get("distortion") or {"model": "none"},
        rotation=tuple(pose["rotation"]),
        translation=tuple(pose["translation"]),
    )


def _image(view: Dict, result: Path) -> Optional[Path]:
    """The photo's file: where the run found it, or where the result's configuration says that photos are."""
    if not view.get("image"):
        return None
    named = Path(view["image"])
    places: List[Path] = [named] if named.is_absolute() else [result.parent / named]
    folder = _images_folder(result)
    if folder is not None:
        places += [folder / view["id"], folder / named.name]
    return next((place for place in places if place.is_file()), None)


def _images_folder(result: Path) -> Optional[Path]:
    """`survey.images` of the configuration that is saved beside a result; it is relative to the result."""
    try:
        text = (result / "config.toml").read_text(encoding="utf-8")
    except OSError:
        return None
    table = re.search(r"^\[survey\]$(.*?)(?=^\[|\Z)", text, re.MULTILINE | re.DOTALL)
    key = re.search(r"""^images = (?:"((?:[^"\\]|\\.)*)"|'([^']*)')$""", table.group(1), re.MULTILINE) if table else None
    if key is None:
        return None
    written = key.group(2) if key.group(1) is None else json.loads(f'"{key.group(1)}"')
    return result / written
