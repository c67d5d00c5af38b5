#!/bin/sh
# Compiles IGSIO's insertion of slices, which the reconstruction is compared with, into out/igsio.
#
#   scripts/peers/igsio.sh FOLDER
#
# FOLDER is a checkout of IGSIO (https://github.com/IGSIO/IGSIO), in any state; nothing in it is
# changed. Only the class that inserts slices is compiled, with Debian's VTK (900 MB): the rest of
# IGSIO needs ITK. `scripts/peers/igsio` has the program around it.
set -eu
cd "$(dirname "$0")/../.."

folder=$1
into=out/igsio
class=vtkIGSIOPasteSliceIntoVolume

top=$folder
[ ! -d "$folder/Source/VolumeReconstruction" ] || top=$folder/Source
part=$top/VolumeReconstruction
if [ ! -f "$part/$class.cxx" ] || [ ! -f "$top/IGSIOCommon/igsioMath.h" ]; then
    echo "peers: $folder is no source folder of IGSIO: $class.cxx is not in its VolumeReconstruction, or igsioMath.h not in its IGSIOCommon; name the folder of its checkout." >&2
    exit 1
fi
scripts/setup.sh igsio

# The newest of Debian's versions.
headers=$(find /usr/include -maxdepth 1 -name 'vtk-*' | sort -V | tail -n 1)
version=${headers##*/vtk-}
libraries=
for library in CommonCore CommonDataModel CommonExecutionModel CommonMath CommonTransforms; do
    libraries="$libraries -lvtk$library-$version"
done

# The name of the source: its commit, if no file differs from it.
if [ "$(git -C "$folder" rev-parse --show-prefix 2>/dev/null || echo none)" = "" ] &&
    git -C "$folder" diff --quiet HEAD; then
    name="commit $(git -C "$folder" rev-parse --short=8 HEAD)"
else
    name="a copy of its files, SHA-256 $(cat "$part/$class"* "$part/fixed.h" "$top/IGSIOCommon/igsioMath.h" | sha256sum | cut -c 1-8)"
fi
licence=$(find "$folder" -maxdepth 1 -iname 'licen[sc]e*' | head -n 1)

mkdir -p "$into"
rm -f "$into/igsio" "$into/source"
# The headers of scripts/peers/igsio come first: they stand for generated ones, and for ITK's.
# shellcheck disable=SC2086 # libraries are words
c++ -std=c++17 -O3 -march=native -w -DNDEBUG -DVTK_OVERRIDE=override \
    -Iscripts/peers/igsio -I"$part" -I"$top/IGSIOCommon" -isystem "$headers" \
    scripts/peers/igsio/contestant.cpp "$part/$class.cxx" -o "$into/igsio" $libraries || {
    echo "peers: the source in $part could not be compiled with VTK $version; the compiler's message is above." >&2
    exit 1
}
echo "$name" >"$into/source"
echo "peers: IGSIO ($name; its licence: ${licence:-none was found in $folder}) is in $into, by -O3 -march=native; make bench now compares with it"
