#!/usr/bin/env bash
# Makes a release of the last commit: the Debian package, and a static program with its pages in a
# tarball. On x86-64 it makes both for arm64, too. Further files are the Python wheel, lists of
# crates (CycloneDX), the version's changes, and SHA256SUMS. The files contain no names of folders
# and no times of the build; scripts/release-test.sh compares two releases. Needs the packages that
# `scripts/setup.sh release` and `scripts/setup.sh python` install, and maturin from Python's
# packages.
#
#   scripts/release.sh [FOLDER]     out/release by default; it is made anew
#
# A commit with a tag v… must have that version and a section of it in CHANGELOG.md.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-out/release}

say() { echo "release: $*" >&2; }
fail() {
    say "$*"
    exit 1
}

umask 022
export LC_ALL=C.UTF-8 TZ=UTC
[ -z "$(git status --porcelain --untracked-files=no)" ] || say "the sources have changes that are not committed; the release will not be that of a commit"
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH

version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"$/\1/p' Cargo.toml)
tag=$(git tag --points-at HEAD --list 'v*' | head -1)
[ -z "$tag" ] || [ "$tag" = "v$version" ] || fail "the tag is $tag and Cargo.toml has $version; correct one of them"
# Prints the section of CHANGELOG.md with this title, without the title.
section() { awk -v title="## $1" '/^## /{ on = $0 == title || index($0, title " ") == 1; next } on' CHANGELOG.md; }
changes=$(section "$version")
if [ -z "$changes" ]; then
    [ -z "$tag" ] || fail "CHANGELOG.md has no section ## $version; rename Unreleased"
    changes=$(section Unreleased)
    say "CHANGELOG.md has no section ## $version; its section Unreleased is taken"
fi

# The program contains no path of this machine, and no tables for debuggers, whose paths the linker
# would add.
export CARGO_PROFILE_RELEASE_DEBUG=0 CARGO_PROFILE_RELEASE_STRIP=symbols CARGO_INCREMENTAL=0
unset RUSTFLAGS
CARGO_ENCODED_RUSTFLAGS=$(printf -- '--remap-path-prefix=%s=/sonoweave\037--remap-path-prefix=%s=/cargo' "$PWD" "${CARGO_HOME:-$HOME/.cargo}")
export CARGO_ENCODED_RUSTFLAGS
here=$(rustc -vV | sed -n 's/^host: //p')
# All programs for this machine are one selection of packages, and so one build.
shared="--target $here -p sonoweave -p sonoweave-packaging"

rm -rf "$folder"
mkdir -p "$folder"
place=$(mktemp -d "$folder/making.XXXXXX")
trap 'rm -rf "$place"' EXIT

say "the Debian package"
SONOWEAVE_RELEASE=$shared scripts/deb.sh "$place/deb"
mv "$place"/deb/*.deb "$folder/"
tools=$(SONOWEAVE_RELEASE=$shared scripts/build.sh)

# list TARGET: the list of a program's crates, and licences.txt among what is made for it.
list() {
    "${tools%/*}/sonoweave-packaging" "$place/made" "$1"
    cp "$place/made/sbom.cdx.json" "$folder/sonoweave-$version-$1.cdx.json"
}
# pack TARGET PROGRAM: a tarball of a static program. This machine's makes the pages.
pack() {
    local name=sonoweave-$version-$1 stage
    stage=$place/$name
    list "$1"
    install -D -m 755 "$2" "$stage/sonoweave"
    "$tools" devices --udev >"$place/rules"
    install -D -m 644 "$place/rules" "$stage/70-sonoweave.rules"
    "$tools" man --all -o "$stage/man"
    mkdir -p "$stage/completions"
    for shell in bash zsh fish; do "$tools" completions $shell -o "$stage/completions/sonoweave.$shell"; done
    scripts/sample.sh "$tools" "$stage/sample"
    mkdir -p "$stage/docs"
    cp -r docs/*.md docs/*.png docs/*.svg docs/examples docs/phantom "$stage/docs/"
    cp -r packaging/fleet "$stage/docs/examples/fleet"
    cp README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE SECURITY.md CITATION.cff "$place/made/licences.txt" "$stage/"
    chmod -R u=rwX,go=rX "$stage"
    tar --sort=name --format=gnu --mtime="@$SOURCE_DATE_EPOCH" --owner=0 --group=0 --numeric-owner \
        -C "$place" -cf - "$name" | gzip -9n >"$folder/$name.tar.gz"
}
for machine in "${here%%-*}" aarch64; do
    target=$machine-unknown-linux-musl
    [ ! -e "$folder/sonoweave-$version-$target.tar.gz" ] || continue
    say "the static program for $machine"
    program=$(SONOWEAVE_RELEASE="--target $target -p sonoweave" scripts/build.sh)
    pack "$target" "$program"
    if [ "$machine" != "${here%%-*}" ]; then
        say "the Debian package for $machine"
        SONOWEAVE_RELEASE=$shared scripts/deb.sh "$place/deb" arm64 "$program"
        mv "$place"/deb/*.deb "$folder/"
    fi
done

say "the Python wheel"
wheel=$(realpath "$place")/wheel
python3 -m venv "$wheel"
"$wheel/bin/pip" --disable-pip-version-check install --quiet "$(grep '^maturin==' python/requirements.txt)"
(cd python && "$wheel/bin/maturin" build --release --locked --target "$here" --interpreter python3 --out "$wheel" --quiet)
mv "$wheel"/*.whl "$folder/"

list "$here"
printf '%s\n' "$changes" | sed -e '/./,$!d' >"$folder/sonoweave-$version-changes.md"
chmod 644 "$folder"/*.*
(cd "$folder" && sha256sum -- *.deb *.tar.gz *.whl *.json *.md >SHA256SUMS && chmod 644 SHA256SUMS)
say "in $folder:"
find "$folder" -maxdepth 1 -type f -printf '%s %f\n' | sort -k 2
