#!/bin/sh
# Installs VTK, which the renderer is compared with, into out/peers (600 MB). Nothing outside of
# that folder is changed.
set -eu
cd "$(dirname "$0")/../.."

version=$(cat scripts/peers/vtk-version)
into=out/peers

if [ -x "$into/bin/python" ] && "$into/bin/python" -c "from vtkmodules.vtkCommonCore import vtkVersion as v; raise SystemExit(v.GetVTKVersion() != '$version')" 2>/dev/null; then
    echo "peers: VTK $version is in $into"
    exit 0
fi
if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
    echo "peers: Python 3 with its venv module is needed (on Debian: apt-get install python3-venv); install it, then run make peers again." >&2
    exit 1
fi
mkdir -p out
# An incomplete environment is made again.
python3 -m venv --clear "$into"
# The caster needs none of the package's dependencies.
"$into/bin/python" -m pip --disable-pip-version-check install --quiet --no-deps --only-binary :all: "vtk==$version" || {
    echo "peers: VTK $version could not be installed for $(python3 --version) from the package index that pip is set up for; its message is above." >&2
    exit 1
}
echo "peers: VTK $version is in $into; make bench now compares with it"
