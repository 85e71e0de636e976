#!/usr/bin/env bash
# Tests a wheel in a fresh environment: types, tests and the example, with NumPy and GeoPandas.
#
#   packaging/test_python.sh [WHEEL]     by default one that uses this system's GDAL and PROJ, built first
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-$PWD/target}
wheel=${1:-$(packaging/wheel.sh system)}
environment=$target/python-test
readonly NUMPY=2.2.6 GEOPANDAS=1.1.1 MYPY=1.18.2
if ! "$environment/bin/python" -c 'import numpy, geopandas, mypy' 2>/dev/null; then
  python3 -m venv --clear "$environment"
  "$environment/bin/pip" install -q --disable-pip-version-check "numpy==$NUMPY" "geopandas==$GEOPANDAS" "mypy==$MYPY"
fi
"$environment/bin/pip" install -q --disable-pip-version-check --force-reinstall --no-deps "$wheel"
"$environment/bin/mypy" --strict --config-file python/pyproject.toml --cache-dir "$target/mypy" --python-executable "$environment/bin/python" python/python/sizeup
"$environment/bin/mypy" --strict --config-file python/pyproject.toml --cache-dir "$target/mypy" --python-executable "$environment/bin/python" python/examples
"$environment/bin/python" -m unittest discover -v python/tests
