"""Decisions of people about buildings, in `reviews.geojson` beside the result. Knows nothing of QGIS.

A GeoJSON of points in longitude and latitude, one per building, so that every GIS shows it too. The program reads the
properties alone (`[reviews] path = "reviews.geojson"`), and no run writes the file: decisions outlive results.
"""

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Dict, Optional, Tuple

FILE_NAME = "reviews.geojson"
CONFIRMED, CORRECTED, WRONG = "confirmed", "corrected", "wrong"
DECISIONS = (CONFIRMED, CORRECTED, WRONG)


class ReviewsError(Exception):
    """The file is none of reviews; the text is for people."""


@dataclass(frozen=True)
class Review:
    """A decision about one building; metres above its ground."""

    building_id: str
    decision: str
    height_m: Optional[float] = None
    sigma_m: Optional[float] = None
    note: str = ""
    author: str = ""
    date: str = ""
    place: Optional[Tuple[float, float]] = None

    def feature(self) -> Dict:
        """As GeoJSON."""
        properties = asdict(self)
        place = properties.pop("place")
        geometry = None if place is None else {"type": "Point", "coordinates": list(place)}
        return {"type": "Feature", "properties": properties, "geometry": geometry}


class Reviews:
    """The decisions about one result, by building."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._by_id: Dict[str, Review] = {}
        if path.is_file():
            self._read()

    def _read(self) -> None:
        try:
            features = json.loads(self.path.read_text(encoding="utf-8"))["features"]
            reviews = [_review(feature) for feature in features]
        except (ValueError, KeyError, TypeError) as error:
            raise ReviewsError(f"{self.path} is no file of reviews: {error}") from error
        self._by_id = {review.building_id: review for review in reviews}

    def get(self, building_id: str) -> Optional[Review]:
        """The decision about a building."""
        return self._by_id.get(building_id)

    def __len__(self) -> int:
        return len(self._by_id)

    def put(self, review: Review) -> None:
        """Takes a decision in, and writes the file."""
        if review.decision not in DECISIONS:
            raise ValueError(f"decision {review.decision!r}: expected one of {', '.join(DECISIONS)}")
        if review.decision != WRONG and not (review.height_m is not None and review.height_m > 0):
            raise ValueError("a height that is confirmed or corrected is a number of metres above 0")
        self._write({**self._by_id, review.building_id: review})

    def remove(self, building_id: str) -> None:
        """Takes a decision back, and writes the file."""
        self._write({key: review for key, review in self._by_id.items() if key != building_id})

    def _write(self, by_id: Dict[str, Review]) -> None:
        """Whole or not at all; only then the decisions here are those in the file."""
        features = [by_id[key].feature() for key in sorted(by_id)]
        text = json.dumps({"type": "FeatureCollection", "features": features}, ensure_ascii=False, indent=1)
        partial = self.path.with_name(f".partial-{self.path.name}")
        partial.write_text(text + "\n", encoding="utf-8")
        os.replace(partial, self.path)
        self._by_id = by_id


def _review(feature: Dict) -> Review:
    properties, geometry = feature["properties"], feature.get("geometry")
    if properties["decision"] not in DECISIONS:
        raise ValueError(f"decision {properties['decision']!r} of {properties['building_id']}")
    known = {name: properties[name] for name in Review.__dataclass_fields__ if properties.get(name) is not None}
    known.pop("place", None)
    place = tuple(geometry["coordinates"][:2]) if geometry else None
    return Review(**{**known, "building_id": str(properties["building_id"]), "place": place})
