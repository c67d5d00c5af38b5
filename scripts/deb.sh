#!/usr/bin/env bash
# Makes a Debian package of this source. The same commit and compiler give the same bytes. Needs the
# packages that `scripts/setup.sh package` installs.
#
#   scripts/deb.sh [FOLDER]     out/deb by default
#   scripts/deb.sh FOLDER ARCHITECTURE PROGRAM
#
# The latter packages a static program for another of Debian's architectures.
#
# dpkg's own tools make it: dpkg-shlibdeps finds the packages that the program needs,
# dpkg-gencontrol and dpkg-deb do the rest. Manual pages, completions, licences and udev rules are
# made from the program's own definitions.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-out/deb}

# The bytes must not depend on the user or the time.
umask 022
export LC_ALL=C.UTF-8 TZ=UTC
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH

version=$(dpkg-parsechangelog --file packaging/debian/changelog --show-field Version)
machine=$(rustc -vV | sed -n 's/^host: //p')
architecture=${2:-$(dpkg --print-architecture)}
program_version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"$/\1/p' Cargo.toml)
[ "$program_version" = "${version%-*}" ] || {
    echo "deb: packaging/debian/changelog says $version and Cargo.toml $program_version; write an entry for this version" >&2
    exit 1
}

built=$(SONOWEAVE_RELEASE=${SONOWEAVE_RELEASE:--p sonoweave -p sonoweave-packaging} scripts/build.sh)
mkdir -p "$folder"
place=$(mktemp -d "$folder/making.XXXXXX")
trap 'rm -rf "$place"' EXIT
stage=$place/stage
program=${3:-$built}
[ -z "${3:-}" ] || machine=$(dpkg-architecture -a "$architecture" -q DEB_HOST_GNU_CPU)-unknown-linux-musl
tools=$(dpkg-architecture -a "$architecture" -q DEB_HOST_GNU_TYPE)
"${built%/*}/sonoweave-packaging" "$place/made" "$machine"

put() { install -D -m "${3:-644}" "$1" "$stage/$2"; }
# Compresses without name and time, which would differ from build to build.
pack() { gzip -9nc "$1" >"$place/packed" && put "$place/packed" "$2.gz"; }

put "$program" usr/bin/sonoweave 755
"$tools-strip" --strip-unneeded --remove-section=.comment --remove-section=.note "$stage/usr/bin/sonoweave"
"$built" man --all -o "$place/made/man"
for page in "$place"/made/man/*; do pack "$page" "usr/share/man/man${page##*.}/${page##*/}"; done
for shell in bash zsh fish; do "$built" completions $shell -o "$place/made/$shell"; done
put "$place/made/bash" usr/share/bash-completion/completions/sonoweave
put "$place/made/zsh" usr/share/zsh/vendor-completions/_sonoweave
put "$place/made/fish" usr/share/fish/vendor_completions.d/sonoweave.fish

put packaging/sonoweave.service usr/lib/systemd/system/sonoweave.service
put packaging/sonoweave.sysusers usr/lib/sysusers.d/sonoweave.conf
"$built" devices --udev >"$place/rules"
put "$place/rules" usr/lib/udev/rules.d/70-sonoweave.rules

# A calibration is the bedside's own: the configuration names none, and no example is installed as
# one.
sed -e 's|fastrak\.toml|/etc/sonoweave/bedside.toml|' -e 's|^file = "probe\.toml" *#|#file = "probe.toml"              #|' \
    docs/examples/fastrak.toml >"$place/bedside.toml"
! grep -q '^file = ' "$place/bedside.toml" || {
    echo "deb: the configuration names a calibration, which would be the example's" >&2
    exit 1
}
put "$place/bedside.toml" etc/sonoweave/bedside.toml

scripts/sample.sh "$built" "$place/sample"
for file in "$place"/sample/*; do put "$file" "usr/share/sonoweave/sample/${file##*/}"; done

documents=usr/share/doc/sonoweave
for example in docs/examples/*.toml; do put "$example" "$documents/examples/${example##*/}"; done
for file in packaging/fleet/*.* packaging/fleet/targets/*; do put "$file" "$documents/examples/${file#packaging/}"; done
for drawn in docs/phantom/nwire.*; do put "$drawn" "$documents/phantom/${drawn##*/}"; done
put packaging/debian/copyright "$documents/copyright"
pack packaging/debian/changelog "$documents/changelog.Debian"
pack "$place/made/licences.txt" "$documents/licences.txt"
pack "$place/made/sbom.cdx.json" "$documents/sbom.cdx.json"
for picture in docs/*.svg docs/*.png; do
    ! grep -qF "(${picture##*/})" docs/*.md || put "$picture" "$documents/${picture##*/}"
done
for page in docs/*.md; do pack "$page" "$documents/${page##*/}"; done

# dpkg's tools look for debian/control and debian/changelog in the current folder.
mkdir -p "$stage/DEBIAN" "$place/debian"
cp packaging/debian/control packaging/debian/changelog "$place/debian/"
control=$(cd "$stage/DEBIAN" && pwd)
for script in postinst prerm postrm; do install -m 755 "packaging/debian/$script" "$control/$script"; done
(cd "$stage" && find etc -type f -printf '/%p\n' | LC_ALL=C sort >"$control/conffiles")
(cd "$stage" && find . -path ./DEBIAN -prune -o -type f -printf '%P\0' | LC_ALL=C sort -z | xargs -0 md5sum >"$control/md5sums")
(
    cd "$place"
    export DEB_HOST_ARCH=$architecture
    if [ "$program" = "$built" ]; then dpkg-shlibdeps -Tsubstvars stage/usr/bin/sonoweave; else echo shlibs:Depends= >substvars; fi
    dpkg-gencontrol -psonoweave -Pstage -Tsubstvars -fdebian/files
)
package=$folder/sonoweave_${version}_$architecture.deb
dpkg-deb --root-owner-group -Zxz --build "$stage" "$package" >/dev/null
echo "$package: $(dpkg-deb --field "$package" Depends), $(du -k "$package" | cut -f1) kB"
