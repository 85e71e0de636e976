#!/usr/bin/env bash
# Installs what is missing, through the distribution's packages, and says so. Does nothing where all is there.
#
#   tools/deps.sh build   what it takes to build and run sizeup
#   tools/deps.sh test    the independent tools that tests compare with: GDAL's programs, cjio, QGIS, a browser (web)
#   tools/deps.sh wheel   what builds GDAL and PROJ from source for the Python wheel: cmake, sqlite3, libtiff
#   tools/deps.sh docs    Python, which writes docs/reference.md
#   tools/deps.sh python trimesh, shapely and scipy in target/python; without them the tests that need them say "skipped"
#   tools/deps.sh qgis    QGIS alone: 220 MB to load, 1 GB on disk; without it the tests that need it say "skipped"
#   tools/deps.sh onnxruntime ONNX Runtime's shared library in target/onnxruntime (24 MB to load); without it networks run in
#                         the embedded engine, and the tests that compare the two say "skipped"
#   tools/deps.sh val3dity a validator of solids, built from its source into target/tools/val3dity (some ten minutes of one
#                         processor): no registry has it. The source is fetched from GitHub, or is a folder named by
#                         VAL3DITY_SOURCE; without it the tests that need it say "skipped". Never part of another target
#   tools/deps.sh citygml the official schemas of CityGML 3.0 with all that they import, in target/tools/citygml (3 MB), from the source of
#                         citygml4j: from GitHub, or a folder named by CITYGML4J_SOURCE; without it the test that needs them says "skipped"
#   tools/deps.sh networks PyTorch and transformers (500 MB on disk), which export real architectures with random weights
#   tools/deps.sh features PyTorch, transformers 5, Depth Anything 3 and SAM 3's own code in target/features, which compute the frozen
#                         features of the paper's footprint network: on Linux 6 GB on disk, less with PYTORCH_INDEX; likewise
#   tools/deps.sh batch   Snakemake with its plugins for Slurm and Kubernetes, and Kubernetes' schemas, in target/batch, some
#                         300 MB; likewise
#   tools/deps.sh web     Node.js, a browser without windows and what drives it, CesiumJS and validators of glTF and 3D Tiles:
#                         some 170 MB to load, 800 MB on disk; likewise
#
# What is no package of the distribution goes into target/tools, with its version.
set -euo pipefail

readonly MIN_RUST=94 # Rust 1.94
readonly SNAKEMAKE=9.27.1 SNAKEMAKE_SLURM=2.8.0 SNAKEMAKE_KUBERNETES=0.5.1 SNAKEMAKE_STORAGE=1.1.3
readonly KUBERNETES_VALIDATE=1.37.0 PYGMENTS=2.21.0
readonly ONNXRUNTIME=1.31.1 TRANSFORMERS=4.48.3 ONNX=1.17.0 DEPTH_ANYTHING_3=0.1.1
readonly TORCH=2.15.0 TORCHVISION=0.29.2 TRANSFORMERS_5=5.24.0 ONNX_5=1.23.2 ONNXSCRIPT=0.7.2 OPENCV=5.0.0.93 SAM3=0.1.4
readonly VAL3DITY=2.6.0 PYSFCGAL=2.3.0 CITYSMITH=0.2.0 CITYGML4J=3.4.1
readonly CJIO=0.10.1 FLATCITYBUF=0.5.2 CESIUM=1.145.0 GLTF_VALIDATOR=2.0.0-dev.3.10 TILES_VALIDATOR=0.6.1 PLAYWRIGHT=1.65.1 AXE=4.14.1
tools="$(cd "$(dirname "$0")/.." && pwd)/target/tools"
readonly tools

say() { printf 'deps: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }

as_root() {
  if [ "$(id -u)" -eq 0 ]; then "$@"
  elif command -v sudo >/dev/null; then sudo "$@"
  else fail "root is needed to run: $* (or install these packages another way and call make again)"
  fi
}

updated=no
install_packages() {
  [ "$#" -gt 0 ] || return 0
  command -v apt-get >/dev/null || fail "missing: $* (Debian's names). Install them with your system's package manager."
  say "installing $* with apt-get"
  if [ "$updated" = no ]; then as_root apt-get update -qq; updated=yes; fi
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

rust_is_new_enough() {
  command -v cargo >/dev/null && command -v rustc >/dev/null || return 1
  local minor
  minor=$(rustc --version | sed -n 's/^rustc 1\.\([0-9]*\)\..*/\1/p')
  [ "${minor:-0}" -ge "$MIN_RUST" ]
}

build_tools() {
  local missing=()
  command -v cc >/dev/null || missing+=(gcc libc6-dev)
  command -v c++ >/dev/null || missing+=(g++)
  command -v pkg-config >/dev/null || missing+=(pkg-config)
  { command -v pkg-config >/dev/null && pkg-config --exists gdal 'proj >= 9.1'; } || missing+=(libgdal-dev libproj-dev)
  [ -e /etc/ssl/certs/ca-certificates.crt ] || missing+=(ca-certificates)
  # ${a[@]+…}: an empty array is "unbound" to older shells.
  install_packages ${missing[@]+"${missing[@]}"}
  if ! rust_is_new_enough; then
    install_packages rustc-web cargo-web
    rust_is_new_enough || fail "Rust 1.$MIN_RUST or newer is needed, found: $(rustc --version 2>/dev/null || echo none).
deps: Debian bookworm has it in its security updates (bookworm-security main in the sources of apt); else see https://rustup.rs"
  fi
}

wheel_tools() {
  local missing=()
  command -v cc >/dev/null || missing+=(gcc libc6-dev)
  command -v c++ >/dev/null || missing+=(g++)
  command -v cmake >/dev/null || missing+=(cmake make)
  command -v sqlite3 >/dev/null || missing+=(sqlite3)
  command -v pkg-config >/dev/null || missing+=(pkg-config)
  { command -v pkg-config >/dev/null && pkg-config --exists libtiff-4; } || missing+=(libtiff-dev)
  python3 -c 'import ensurepip' 2>/dev/null || missing+=(python3 python3-venv)
  install_packages ${missing[@]+"${missing[@]}"}
}

test_tools() {
  local missing=()
  command -v ogrinfo >/dev/null || missing+=(gdal-bin)
  # Reads what a browser prints.
  command -v pdftotext >/dev/null || missing+=(poppler-utils)
  command -v python3 >/dev/null || missing+=(python3)
  python3 -c 'import ensurepip' 2>/dev/null || missing+=(python3-venv)
  # What tools/exports.py writes other programs' files with.
  /usr/bin/python3 -c 'import numpy, PIL, osgeo' 2>/dev/null || missing+=(python3-gdal python3-numpy python3-pil)
  install_packages ${missing[@]+"${missing[@]}"}
  if ! "$tools/cjio/bin/cjio" --version 2>/dev/null | grep -q "$CJIO"; then
    say "installing cjio $CJIO into target/tools"
    # Only the tests that use it are skipped without it.
    { python3 -m venv "$tools/cjio" && "$tools/cjio/bin/pip" install -q --disable-pip-version-check "cjio==$CJIO"; } ||
      say "cjio could not be installed: the tests that use it are skipped"
  fi
  if ! "$tools/flatcitybuf/bin/pip" show flatcitybuf 2>/dev/null | grep -q "$FLATCITYBUF"; then
    say "installing flatcitybuf $FLATCITYBUF into target/tools"
    { python3 -m venv "$tools/flatcitybuf" &&
      "$tools/flatcitybuf/bin/pip" install -q --disable-pip-version-check "flatcitybuf==$FLATCITYBUF"; } ||
      say "flatcitybuf could not be installed: the test that uses it is skipped"
  fi
  if ! "$tools/sfcgal/bin/pip" show pysfcgal 2>/dev/null | grep -q "$PYSFCGAL"; then
    say "installing pysfcgal $PYSFCGAL into target/tools"
    { python3 -m venv "$tools/sfcgal" && "$tools/sfcgal/bin/pip" install -q --disable-pip-version-check "pysfcgal==$PYSFCGAL"; } ||
      say "pysfcgal could not be installed: the tests that ask SFCGAL are skipped"
  fi
  if ! "$tools/citysmith/bin/pip" show citysmith 2>/dev/null | grep -q "$CITYSMITH"; then
    say "installing citysmith $CITYSMITH into target/tools"
    { python3 -m venv "$tools/citysmith" && "$tools/citysmith/bin/pip" install -q --disable-pip-version-check "citysmith==$CITYSMITH"; } ||
      say "citysmith could not be installed: the test of CityGML by its schemas is skipped"
  fi
  ( qgis ) || say "QGIS could not be installed: the tests that open results in it are skipped"
  ( web ) || say "no browser could be installed: the tests that open pages in it are skipped"
}

web() {
  local missing=()
  command -v node >/dev/null || missing+=(nodejs)
  command -v npm >/dev/null || missing+=(npm)
  install_packages ${missing[@]+"${missing[@]}"}
  # Debian's browser without windows needs 30 packages, the whole one 90. Other distributions have only that, if any.
  { command -v chromium-headless-shell || command -v chromium; } >/dev/null || install_packages chromium-headless-shell
  mkdir -p "$tools/web"
  # One by one: a registry may lack one of them, and only its tests are skipped then.
  local package
  for package in "gltf-validator@$GLTF_VALIDATOR" "cesium@$CESIUM" "3d-tiles-validator@$TILES_VALIDATOR" \
    "playwright-core@$PLAYWRIGHT" "axe-core@$AXE"; do
    if [ ! -d "$tools/web/node_modules/${package%@*}" ]; then
      say "installing $package into target/tools"
      npm install --prefix "$tools/web" --no-audit --no-fund --silent "$package" ||
        say "$package could not be installed: the tests that use it are skipped"
    fi
  done
}

qgis() {
  /usr/bin/python3 -c 'import qgis.core, qgis._3d' 2>/dev/null || install_packages qgis python3-qgis xvfb xauth libgl1-mesa-dri
  command -v lrelease >/dev/null || install_packages qttools5-dev-tools # translations of the plugin
}

python_tools() {
  local folder=target/python
  "$folder/bin/python" -c 'import numpy, scipy, shapely, trimesh, rtree' 2>/dev/null && return 0
  python3 -m venv --help >/dev/null 2>&1 || install_packages python3 python3-venv
  say "installing numpy, scipy, shapely, trimesh and rtree into $folder"
  python3 -m venv "$folder"
  "$folder/bin/pip" install --quiet numpy==2.4.6 scipy==1.17.1 shapely==2.2.0 trimesh==5.2.0 rtree==1.4.1
}

onnxruntime() {
  local folder=target/onnxruntime
  [ -e "$folder/$ONNXRUNTIME" ] && return 0
  python3 -c 'import ensurepip' 2>/dev/null || install_packages python3 python3-venv
  say "fetching ONNX Runtime $ONNXRUNTIME into $folder"
  local wheel
  wheel=$(mktemp -d)
  # A Python of its own: the system's may have no pip.
  python3 -m venv "$wheel/python"
  "$wheel/python/bin/pip" download --quiet --disable-pip-version-check --no-deps --only-binary :all: --dest "$wheel" \
    "onnxruntime==$ONNXRUNTIME"
  mkdir -p "$folder"
  # The library alone, under the name that it is looked for; the wheel's other parts are for Python.
  python3 - "$wheel"/*.whl "$folder" <<'PYTHON'
import pathlib, re, sys, zipfile
wheel, folder = sys.argv[1:]
with zipfile.ZipFile(wheel) as files:
    [name] = [n for n in files.namelist() if re.search(r"/capi/(libonnxruntime\.so\.[0-9.]+|libonnxruntime\.[0-9.]+\.dylib)$", n)]
    library = "libonnxruntime.so" if ".so" in name else "libonnxruntime.dylib"
    pathlib.Path(folder, library).write_bytes(files.read(name))
    for name in files.namelist():
        if re.search(r"^onnxruntime/(LICENSE|ThirdPartyNotices.txt)$", name):
            pathlib.Path(folder, pathlib.Path(name).name).write_bytes(files.read(name))
PYTHON
  rm -rf "$wheel"
  touch "$folder/$ONNXRUNTIME"
}

val3dity() {
  "$tools/val3dity" --version 2>/dev/null | grep -q "$VAL3DITY" && return 0
  local missing=()
  command -v c++ >/dev/null || missing+=(g++)
  command -v cmake >/dev/null || missing+=(cmake make)
  local library
  for library in libcgal-dev libeigen3-dev libboost-filesystem-dev libgeos-dev; do
    dpkg -s "$library" >/dev/null 2>&1 || missing+=("$library")
  done
  install_packages ${missing[@]+"${missing[@]}"}
  local work
  work=$(mktemp -d)
  local source="${VAL3DITY_SOURCE:-$work/source}"
  if [ -z "${VAL3DITY_SOURCE:-}" ]; then
    command -v git >/dev/null || install_packages git
    say "fetching the source of val3dity $VAL3DITY"
    git clone --quiet --depth 1 --branch "$VAL3DITY" https://github.com/tudelft3d/val3dity "$source" ||
      fail "its source could not be fetched: name a folder with it, VAL3DITY_SOURCE=FOLDER make deps-val3dity"
  fi
  say "building val3dity into target/tools"
  cmake -S "$source" -B "$work/build" >/dev/null
  cmake --build "$work/build" --parallel "$(nproc)" >/dev/null
  mkdir -p "$tools"
  cp "$work/build/val3dity" "$tools/val3dity"
  rm -rf "$work"
}

citygml() {
  [ -e "$tools/citygml/$CITYGML4J" ] && return 0
  local work schemas=citygml4j-xml/src/main/resources/org/citygml4j/schemas
  work=$(mktemp -d)
  local source="${CITYGML4J_SOURCE:-$work/source}"
  if [ -z "${CITYGML4J_SOURCE:-}" ]; then
    command -v git >/dev/null || install_packages git
    say "fetching the schemas of CityGML 3.0 from citygml4j $CITYGML4J"
    { git clone --quiet --depth 1 --filter=blob:none --sparse --branch "v$CITYGML4J" https://github.com/citygml4j/citygml4j "$source" &&
      git -C "$source" sparse-checkout set "$schemas"; } ||
      fail "its source could not be fetched: name a folder with it, CITYGML4J_SOURCE=FOLDER make deps-citygml"
  fi
  mkdir -p "$tools/citygml"
  cp -r "$source/$schemas/." "$tools/citygml"
  rm -rf "$work"
  touch "$tools/citygml/$CITYGML4J"
}

networks() {
  local folder=target/networks
  "$folder/bin/python" -c 'import torch, transformers, onnx, einops, omegaconf' 2>/dev/null && return 0
  # Debian's PyTorch: PyPI's for Linux comes with some gigabytes for GPUs.
  /usr/bin/python3 -c 'import torch, ensurepip' 2>/dev/null || install_packages python3-torch python3-venv
  say "installing transformers $TRANSFORMERS and depth-anything-3 $DEPTH_ANYTHING_3 into $folder"
  /usr/bin/python3 -m venv --system-site-packages "$folder"
  "$folder/bin/pip" install --quiet --disable-pip-version-check "transformers==$TRANSFORMERS" "onnx==$ONNX" "numpy<2" \
    "opencv-python-headless<4.12" einops omegaconf addict "onnxruntime==$ONNXRUNTIME"
  # Its requirements include viewers and point-cloud libraries that exporting does not touch.
  "$folder/bin/pip" install --quiet --disable-pip-version-check --no-deps "depth-anything-3==$DEPTH_ANYTHING_3" ||
    say "depth-anything-3 could not be installed: only Depth Anything V2 is exported"
}

features() {
  local folder=target/features
  local whole="$folder/torch-$TORCH-transformers-$TRANSFORMERS_5-sam3-$SAM3"
  [ -e "$whole" ] && return 0
  python3 -c 'import ensurepip' 2>/dev/null || install_packages python3 python3-venv
  say "installing PyTorch $TORCH, transformers $TRANSFORMERS_5 and depth-anything-3 $DEPTH_ANYTHING_3 into $folder"
  python3 -m venv --clear "$folder" # what is there may be half of it
  local pip=("$folder/bin/pip" install --quiet --disable-pip-version-check)
  # For Linux PyPI has PyTorch with all for GPUs; PYTORCH_INDEX names an index with a smaller one, such as PyTorch's own for CPUs.
  "${pip[@]}" ${PYTORCH_INDEX:+--index-url "$PYTORCH_INDEX"} "torch==$TORCH" "torchvision==$TORCHVISION"
  "${pip[@]}" "transformers==$TRANSFORMERS_5" "onnx==$ONNX_5" "onnxscript==$ONNXSCRIPT" "onnxruntime==$ONNXRUNTIME" \
    "opencv-python-headless==$OPENCV" einops==0.8.2 omegaconf==2.4.0 addict==2.4.0 imageio==2.38.1 \
    timm==1.0.31 ftfy==6.3.1 iopath==0.1.10
  # Their requirements include viewers, trackers and older versions of what is there, which features do not touch. sam3 is what
  # tools/check_footprint_features.py compares with.
  say "sam3 comes under the SAM License, depth-anything-3 under Apache-2.0"
  "${pip[@]}" --no-deps "depth-anything-3==$DEPTH_ANYTHING_3" "sam3==$SAM3"
  touch "$whole"
}

batch() {
  local folder=target/batch
  "$folder/bin/snakemake" --version 2>/dev/null | grep -qx "$SNAKEMAKE" &&
    "$folder/bin/python" -c 'import pygments' 2>/dev/null && # which `snakemake --report` needs
    "$folder/bin/kubernetes-validate" --version 2>/dev/null | grep -q "$KUBERNETES_VALIDATE" && return 0
  python3 -c 'import ensurepip' 2>/dev/null || install_packages python3 python3-venv
  command -v rsync >/dev/null || install_packages rsync # Snakemake's storage on a volume copies with it
  say "installing Snakemake $SNAKEMAKE into $folder"
  python3 -m venv "$folder"
  "$folder/bin/pip" install --quiet --disable-pip-version-check "snakemake==$SNAKEMAKE" \
    "snakemake-executor-plugin-slurm==$SNAKEMAKE_SLURM" "snakemake-executor-plugin-kubernetes==$SNAKEMAKE_KUBERNETES" \
    "snakemake-storage-plugin-fs==$SNAKEMAKE_STORAGE" "kubernetes-validate==$KUBERNETES_VALIDATE" \
    "pygments==$PYGMENTS"
}

case "${1:-build}" in
  build) build_tools ;;
  docs) build_tools; command -v python3 >/dev/null || install_packages python3 ;;
  test) build_tools; test_tools ;;
  python) python_tools ;;
  qgis) qgis ;;
  web) web ;;
  batch) batch ;;
  onnxruntime) onnxruntime ;;
  networks) networks ;;
  features) features ;;
  val3dity) val3dity ;;
  citygml) citygml ;;
  wheel) wheel_tools ;;
  *) fail "usage: tools/deps.sh build|test|wheel|python|qgis|web|batch|onnxruntime|val3dity|citygml|networks|features|docs" ;;
esac
