"""The program's messages in the words of the dialogs: no options, no keys of the settings' file. Knows nothing of QGIS."""

import re
from typing import List, Tuple

# What the program calls something, and what the dialogs call it. The first that fits is taken.
_NAMES: List[Tuple[str, str]] = [
    (r"`sizeup survey inspect[^`]*`", "the algorithm “Inspect survey”"),
    (r"`?sizeup init`? again with --force", "this algorithm again"),
    (r"`?sizeup init`?", "the algorithm “City from a folder of photos”"),
    (r"`?sizeup run[^`\n]*`?", "the algorithm “Estimate heights”"),
    (r"--footprints\b", "“Building footprints”"),
    (r"`?terrain\.dtm`?|--dtm\b|`\[?dtm\]?`", "“Terrain model”"),
    (r"--ground METRES|--ground\b|`?terrain\.constant_m`?", "“Height of the ground”"),
    (r", such as --crs (EPSG:\S+):", r", such as \1:"),
    (r"--crs\b|`?project\.crs`?", "“CRS of the results”"),
    (r"--offset X,Y,Z|--offset\b|`?survey\.offset`?", "“Offset of the poses”"),
    (r"set `offset`, or `enu_origin`",
     "give the “Offset of the poses”, or use “City from a folder of photos”, which finds it in the files"),
    (r"`offset`", "“Offset of the poses”"),
    (r"`survey\.accept_unsound = true`", "survey.accept_unsound=true under “Further settings”"),
    (r"`?survey\.images`?", "“Folder of the photos”"),
    (r"`?survey\.crs`?", "“CRS of the poses”"),
    (r"`?survey\.height\.base`?", "height of the take-off"),
    (r"`?(survey\.height\.)?geoid_offset`?( in \[survey\.height\])?", "height of the zero above the ellipsoid"),
    (r" \((\[dtm\]|vertical_offset_m)\)", ""),
    (r"\[survey\.height\](, as in reference = \"above_takeoff\" with base)?", "what the poses' heights count from"),
    (r"\[survey\.camera\]", "the camera's settings"),
    (r"^\[\w+(\.\w+)*\] ", ""),
]
_PATTERNS = [(re.compile(pattern, re.MULTILINE), words) for pattern, words in _NAMES]


def in_words_of_the_dialog(text: str) -> str:
    """A message of the program, as the dialogs call what it is about."""
    for pattern, words in _PATTERNS:
        text = pattern.sub(words, text)
    return text
