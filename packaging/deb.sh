#!/usr/bin/env bash
# Packs target/packages/sizeup_VERSION_ARCHITECTURE.deb for the Debian or Ubuntu that it runs on: the program, shell completions,
# manual pages, documentation and licences. GDAL and PROJ are the distribution's: dpkg-shlibdeps finds their names in the program.
#
#   packaging/deb.sh [PROGRAM]     PROGRAM: one that is built already; otherwise it is built
#
# The same program and commit give the same bytes.
set -euo pipefail
cd "$(dirname "$0")/.."
say() { printf 'deb: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }
for tool in dpkg-deb dpkg-shlibdeps strip; do
  command -v "$tool" >/dev/null || fail "no $tool
deb: hint: a package is made on Debian or Ubuntu: apt-get install dpkg-dev binutils"
done

target=${CARGO_TARGET_DIR:-$PWD/target}
program=${1:-$target/release/sizeup}
[ $# -gt 0 ] || ${CARGO:-cargo} build --release --locked --features full
[ -x "$program" ] || fail "no program at $program"
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
[ "$("$program" --version)" = "sizeup $version" ] || fail "$program is $("$program" --version), this is $version"
architecture=$(dpkg --print-architecture)
# As the last commit; outside a repository, as the changelog.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || stat -c %Y CHANGELOG.md)}
export SOURCE_DATE_EPOCH

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
root=$work/root
share=$root/usr/share
docs=$share/doc/sizeup
install -D -m 755 "$program" "$root/usr/bin/sizeup"
strip --strip-unneeded --remove-section=.comment "$root/usr/bin/sizeup"

complete() { mkdir -p "$(dirname "$share/$2")"; "$program" completions "$1" > "$share/$2"; }
complete bash bash-completion/completions/sizeup
complete zsh zsh/vendor-completions/_sizeup
complete fish fish/vendor_completions.d/sizeup.fish
"$program" man --output "$share/man/man1"
gzip -9n "$share"/man/man1/*.1

install -D -m 644 -t "$docs" README.md
install -D -m 644 -t "$docs/docs" docs/*.md
install -D -m 644 CHANGELOG.md "$docs/changelog" && gzip -9n "$docs/changelog"
cat > "$docs/copyright" <<COPYRIGHT
Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: sizeup

Files: *
Copyright: 2026 The sizeup authors
License: Expat or Apache-2.0

License: Expat
$(sed -n '/^Permission/,$p' LICENSE-MIT | sed 's/^$/./; s/^/ /')

License: Apache-2.0
 On Debian systems the text is in /usr/share/common-licenses/Apache-2.0.
COPYRIGHT

# dpkg-shlibdeps wants to stand in a source package.
mkdir -p "$work/debian"
printf 'Source: sizeup\n\nPackage: sizeup\nArchitecture: any\n' > "$work/debian/control"
depends=$(cd "$work" && dpkg-shlibdeps -O --ignore-missing-info root/usr/bin/sizeup 2>/dev/null | sed -n 's/^shlibs:Depends=//p')
grep -q libgdal <<< "$depends" || fail "$program needs no libgdal of the distribution's: is it one that brings its own?"

mkdir -p "$root/DEBIAN"
cat > "$root/DEBIAN/control" <<CONTROL
Package: sizeup
Version: $version
Architecture: $architecture
Maintainer: sizeup maintainers <maintainers@users.noreply.example>
Section: science
Priority: optional
Installed-Size: $(du -sk --apparent-size "$root/usr" | cut -f1)
Depends: $depends, proj-data
Suggests: qgis
Description: heights of buildings from oblique aerial photos
 sizeup finds the heights of buildings in oblique aerial photos with known
 poses, and writes a georeferenced LOD1 city as CityJSON and GeoPackage. It
 needs building footprints and one depth map per photo, of which only the order
 of near and far has to be right; or it matches the photos with each other.
CONTROL
(cd "$root" && find usr -type f -print0 | sort -z | xargs -0 md5sum > DEBIAN/md5sums)
find "$root" -print0 | xargs -0 touch --no-dereference --date="@$SOURCE_DATE_EPOCH"
chmod -R u=rwX,go=rX "$root"

mkdir -p "$target/packages"
package=$target/packages/sizeup_${version}_$architecture.deb
dpkg-deb --root-owner-group -Zxz --build "$root" "$package.part" >/dev/null
mv "$package.part" "$package"
echo "$package"
