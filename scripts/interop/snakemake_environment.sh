#!/bin/sh
# Installs Snakemake, which runs the example of docs/cluster.md, into out/snakemake (140 MB), from
# the package index that pip is set up for. Nothing outside of that folder is changed.
set -eu
cd "$(dirname "$0")/../.."

wanted=scripts/interop/snakemake.txt
into=out/snakemake

# The list of packages is copied last: with it, the environment is complete.
if [ -x "$into/bin/snakemake" ] && cmp -s "$wanted" "$into/installed.txt"; then
    echo "interop: Snakemake is in $into"
    exit 0
fi
if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
    scripts/setup.sh interop
fi
mkdir -p out
# An incomplete environment is made again.
python3 -m venv --clear "$into"
"$into/bin/python" -m pip --disable-pip-version-check install --quiet --requirement "$wanted" || {
    echo "interop: $wanted could not be installed for $(python3 --version); pip's message is above." >&2
    exit 1
}
cp "$wanted" "$into/installed.txt"
echo "interop: Snakemake is in $into"
