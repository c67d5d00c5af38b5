#!/usr/bin/env bash
# The drivers against the kernel's own: each test binary runs in a guest whose kernel has the devices that it needs. scripts/guest/README.md tells more.
#
#   scripts/hardware-test.sh [FILTER]   only tests whose names contain FILTER
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/guest/prepare.sh

# Builds a test binary of the drivers and runs it with the given modules.
in_guest() {
    local test=$1 modules=$2 program
    shift 2
    # The last line that names an executable is the test's.
    program=$(cargo test --locked -p sonoweave-drivers --test "$test" --no-run --message-format=json-render-diagnostics |
        sed -n 's/.*"executable":"\([^"]*\)".*/\1/p' | tail -n 1)
    scripts/guest/run.sh "$modules" "$program" --test-threads=1 --color=never "$@"
}

# vivid: /dev/video0 captures (inputs: a camera, HDMI, S-Video), /dev/video1 is an HDMI output that can be looped back; with its controls of faults.
in_guest guest_grabber "vivid n_devs=1 node_types=0x0101 num_inputs=3 input_types=0x2c num_outputs=1 output_types=0x1 no_error_inj=0" "$@"
