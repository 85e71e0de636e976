#!/usr/bin/env bash
# Packs the QGIS plugin: sizeup-qgis-VERSION.zip, as Plugins > Manage and Install Plugins > Install from ZIP takes it.
#
#   tools/qgis_plugin.sh [FOLDER]        into FOLDER, by default target/
#
# The same files give the same bytes: entries are sorted, and their times and modes fixed. Translations (qgis/sizeup/i18n/*.ts)
# are compiled where Qt's lrelease is installed.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
folder=${1:-${CARGO_TARGET_DIR:-$root/target}}
mkdir -p "$folder"
if compgen -G "$root/qgis/sizeup/i18n/*.ts" > /dev/null && command -v lrelease > /dev/null; then
  lrelease -silent "$root"/qgis/sizeup/i18n/*.ts
fi
exec python3 - "$root" "$folder" <<'PYTHON'
import configparser
import sys
import zipfile
from pathlib import Path

root, folder = map(Path, sys.argv[1:])
plugin = root / "qgis" / "sizeup"
metadata = configparser.ConfigParser(interpolation=None)
metadata.read(plugin / "metadata.txt", encoding="utf-8")
target = folder / f"sizeup-qgis-{metadata['general']['version']}.zip"
left_out = {"__pycache__", ".mypy_cache", ".ruff_cache"}
files = [path for path in plugin.rglob("*") if path.is_file() and not left_out & set(path.relative_to(plugin).parts)]
entries = {f"sizeup/{path.relative_to(plugin).as_posix()}": path for path in files if path.suffix not in (".pyc", ".ts")}
entries["sizeup/LICENSE"] = root / "LICENSE-MIT"
with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
    for name in sorted(entries):
        entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
        entry.compress_type, entry.create_system, entry.external_attr = zipfile.ZIP_DEFLATED, 3, 0o100644 << 16
        archive.writestr(entry, entries[name].read_bytes())
print(target)
PYTHON
