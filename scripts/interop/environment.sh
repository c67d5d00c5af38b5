#!/bin/sh
# Makes the environment of the programs that read our image files and write theirs: out/interop, some 800 MB, from the package index that pip is set up for. Nothing
# outside of it is changed; remove it by removing the folder.
set -eu
cd "$(dirname "$0")/../.."

wanted=scripts/interop/requirements.txt
into=out/interop

# What was installed is what is wanted.
if [ -x "$into/bin/python" ] && cmp -s "$wanted" "$into/installed.txt"; then
    echo "interop: what is wanted is in $into"
    exit 0
fi
if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
    scripts/setup.sh interop
fi
mkdir -p out
# A half-made environment is made anew.
python3 -m venv --clear "$into"
# pyigtl needs crcmod, of which there is no wheel: it is built, in C or without.
"$into/bin/python" -m pip --disable-pip-version-check install --quiet --only-binary :all: --no-binary crcmod --requirement "$wanted" || {
    echo "interop: $wanted could not be installed for $(python3 --version); pip's message is above." >&2
    exit 1
}
cp "$wanted" "$into/installed.txt"
echo "interop: SimpleITK, VTK, pynrrd, nibabel, pydicom and pyigtl are in $into"
