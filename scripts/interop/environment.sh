#!/bin/sh
# Installs the programs that read our image files and write theirs into out/interop (800 MB), from
# the package index that pip is set up for. Nothing outside of that folder is changed.
set -eu
cd "$(dirname "$0")/../.."

wanted=scripts/interop/requirements.txt
into=out/interop

# The list of packages is copied last: with it, the environment is complete.
if [ -x "$into/bin/python" ] && cmp -s "$wanted" "$into/installed.txt"; then
    echo "interop: the other programs are in $into"
    exit 0
fi
if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
    scripts/setup.sh interop
fi
mkdir -p out
# An incomplete environment is made again.
python3 -m venv --clear "$into"
# crcmod, which pyigtl needs, has no wheel: it is built, with or without a C compiler.
"$into/bin/python" -m pip --disable-pip-version-check install --quiet --only-binary :all: --no-binary crcmod --requirement "$wanted" || {
    echo "interop: $wanted could not be installed for $(python3 --version); pip's message is above." >&2
    exit 1
}
cp "$wanted" "$into/installed.txt"
echo "interop: SimpleITK, VTK, pynrrd, nibabel, pydicom, pyigtl, mcap and zarr are in $into"
