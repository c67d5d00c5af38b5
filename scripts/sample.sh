#!/bin/sh
# Makes the sample of the package and of the tarball, 2 MB: a session, a sweep over a doll, and two
# scans of a phantom of N-wires with the phantom's description and the true calibration. The program
# makes all but the session, which it has recorded earlier; its bits must not depend on the day.
#
#   scripts/sample.sh PROGRAM FOLDER     the folder is created
set -eu
program=$(realpath "$1")
mkdir -p "$2"
cp "$(dirname "$0")/../tests/recordings/sessions/demo.mcap" "$2/session.mcap"
chmod 644 "$2/session.mcap"
cd "$2"
phantom() { "$program" --quiet phantom --image-size 320x240 --compress "$@"; }
scan() { phantom --scene n-wire --tracker-noise 0.05,0.05 "$@"; }
{
    phantom --scene doll --seed 1 -o doll.igs.mha
    scan --seed 1 -o wires.igs.mha --phantom phantom.toml --calibration truth.toml
    scan --seed 2 --frames 60 -o check.igs.mha --calibration truth.toml
} >/dev/null
