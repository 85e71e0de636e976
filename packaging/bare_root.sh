#!/usr/bin/env bash
# Installs a package in a bare Debian without a compiler, GDAL or PROJ, as somebody would who has nothing, runs the demo, and says how
# long that took and how much it is. Needs root, debootstrap, and the distribution's mirror (and PyPI for the wheel's test).
#
#   packaging/bare_root.sh deb PACKAGE.deb
#   packaging/bare_root.sh wheel PACKAGE.whl
set -euo pipefail
say() { printf 'bare root: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }
[ $# -eq 2 ] || fail "usage: $0 deb|wheel PACKAGE"
kind=$1 package=$(realpath "$2")
[ -f "$package" ] || fail "no package at $2"
here=$(cd "$(dirname "$0")/.." && pwd)
target=${CARGO_TARGET_DIR:-$here/target}
[ "$(id -u)" -eq 0 ] || fail "a root folder is entered by root: run it with sudo"
command -v debootstrap >/dev/null || fail "no debootstrap
bare root: hint: apt-get install debootstrap"
release=$(. /etc/os-release && echo "$VERSION_CODENAME")
mirror=${MIRROR:-http://deb.debian.org/debian}
packed=$target/packages/bare-$release.tar

# Once per release: what a bare root is does not change with the package.
if [ ! -e "$packed" ]; then
  say "making a bare $release"
  mkdir -p "$target/packages"
  fresh=$(mktemp -d)
  debootstrap --variant=minbase "$release" "$fresh" "$mirror" >&2
  # Lists of packages are fetched once here: that is not the package's time.
  chroot "$fresh" apt-get update -qq
  tar -cf "$packed.part" -C "$fresh" .
  mv "$packed.part" "$packed"
  rm -rf "$fresh"
fi

root=$(mktemp -d)
in_root() { chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 ${http_proxy:+http_proxy="$http_proxy"} ${https_proxy:+https_proxy="$https_proxy"} bash -euo pipefail -c "$1"; }
leave() { umount "$root/proc" 2>/dev/null || true; rm -rf --one-file-system "$root"; }
trap leave EXIT
tar -xf "$packed" -C "$root"
mount -t proc proc "$root/proc"
cp /etc/resolv.conf "$root/etc/resolv.conf"
cp "$package" "$root/root/"
# Registries behind an organisation's certificates.
mkdir -p "$root/etc/ssl/certs" && cp -L /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
# That of the distribution takes its place once Python is installed.
cp -L /etc/ssl/certs/ca-certificates.crt "$root/root/registries.crt"
file=/root/$(basename "$package")
for tool in cc gcc g++ rustc cargo ogrinfo gdalinfo; do
  ! in_root "command -v $tool" >/dev/null || fail "this root is not bare: it has $tool"
done

now() { date +%s.%N; }
since() { awk -v a="$1" -v b="$(now)" 'BEGIN { printf "%.1f", b - a }'; }
used_mb() { du -sxm --exclude="$root/proc" "$root" | cut -f1; }

before_mb=$(used_mb)
case $kind in
  deb)
    program=sizeup
    began=$(now)
    in_root "DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $file" >"$root/root/install.log" 2>&1 || { tail -20 "$root/root/install.log" >&2; fail "it cannot be installed"; }
    ;;
  wheel)
    # Python is there on a machine where people use it; the time counts from there.
    in_root "DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends python3 python3-venv" >"$root/root/python.log" 2>&1
    before_mb=$(used_mb)
    program=/root/venv/bin/sizeup
    began=$(now)
    in_root "python3 -m venv /root/venv && /root/venv/bin/pip install -q --disable-pip-version-check $file" >&2
    ;;
  *) fail "no such kind: $kind (deb or wheel)" ;;
esac
installed_s=$(since "$began")
installed_mb=$(($(used_mb) - before_mb))
in_root "cd /root && $program demo" > "$root/root/demo.txt" 2> "$root/root/demo.log" || { tail -30 "$root/root/demo.log" >&2; fail "the demo failed"; }
picture_s=$(since "$began")
for made in report.html city.gpkg city.city.json pictures/overview.png; do
  [ -s "$root/root/sizeup-demo/result/$made" ] || fail "the demo made no $made"
done
grep '^all ' "$root/root/demo.txt" >&2

started=$(now)
for _ in 1 2 3 4 5 6 7 8 9 10; do in_root "$program --version" >/dev/null; done
start_ms=$(awk -v a="$started" -v b="$(now)" 'BEGIN { printf "%.0f", (b - a) * 100 }')
in_root "cd /root && $program check" >&2 || true

if [ "$kind" = deb ]; then
  in_root "test -s /usr/share/man/man1/sizeup-run.1.gz && bash -n /usr/share/bash-completion/completions/sizeup"
  in_root "apt-get remove -y -qq sizeup >/dev/null 2>&1 && ! command -v sizeup"
else
  in_root "PIP_CERT=/root/registries.crt /root/venv/bin/pip install -q --disable-pip-version-check numpy" >&2
  cp "$here/python/examples/heights_from_arrays.py" "$root/root/"
  in_root "cd /root && /root/venv/bin/python heights_from_arrays.py" >&2
  in_root "cd /root && /root/venv/bin/python -c 'import sizeup; city = sizeup.read(\"sizeup-demo/result\"); assert len(city) == 46, len(city); print(city.crs, city.buildings[0])'" >&2
fi
echo "$kind: package $(du -m --apparent-size "$package" | cut -f1) MB, installed $installed_mb MB with what it depends on, in $installed_s s; a picture after $picture_s s; --version in $start_ms ms"
