#!/bin/sh
# Installs the other programs of a list, scripts/interop/NAME.txt, into out/NAME, from the package
# index that pip is set up for. Nothing outside of that folder is changed.
#
#   scripts/interop/environment.sh interop|snakemake
#
# interop: readers and writers of our files and messages (800 MB).
# snakemake: Snakemake, which runs the example of docs/cluster.md (140 MB).
set -eu
cd "$(dirname "$0")/../.."

name=${1:-}
wanted=scripts/interop/$name.txt
into=out/$name
[ -f "$wanted" ] || {
    echo "environment: there is no list \"$name\"; give interop or snakemake" >&2
    exit 2
}

# The list of packages is copied last: with it, the environment is complete.
if [ -x "$into/bin/python" ] && cmp -s "$wanted" "$into/installed.txt"; then
    echo "$name: the other programs are in $into"
    exit 0
fi
if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
    scripts/setup.sh interop
fi
mkdir -p out
# An incomplete environment is made again.
python3 -m venv --clear "$into"
"$into/bin/python" -m pip --disable-pip-version-check install --quiet --no-compile --requirement "$wanted" || {
    echo "$name: $wanted could not be installed for $(python3 --version); pip's message is above." >&2
    exit 1
}
cp "$wanted" "$into/installed.txt"
echo "$name: the programs of $wanted are in $into"
