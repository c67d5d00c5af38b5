#!/usr/bin/env bash
# Tests the drivers against the kernel's own: each test binary runs in a guest whose kernel has the
# devices that it needs. scripts/guest/README.md describes the guest.
#
#   scripts/hardware-test.sh [FILTER]   only tests whose names contain FILTER
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/guest/prepare.sh

# Further hardware of the next guest's machine: options of scripts/guest/run.sh.
machine=()
found=
# Built by one command: another one would wait for builds that have begun beside the first guest.
# With the packages of `make test`, so that both share one build.
programs=$(cargo test --workspace --exclude sonoweave-figures --exclude sonoweave-python --locked --no-run \
    --test guest_grabber --test guest_usb --test guest_serial --test guest_power --message-format=json-render-diagnostics |
    sed -n 's#.*"executable":"\([^"]*\)".*#\1#p')
# built TEST FILTER…: sets `program` to a test binary; fails if no test has the filter in its name.
built() {
    local test=$1
    shift
    program=$(grep "/$test-[^/]*\$" <<<"$programs" | tail -n 1) || {
        echo "hardware-test: cargo did not name the program $test" >&2
        exit 1
    }
    [[ $("$program" --list "$@") == *": test"* ]] && found=yes
}
# in_guest TEST MODULES FILTER…: runs a test binary in a guest with these modules.
in_guest() {
    local test=$1 modules=$2 program
    shift 2
    built "$test" "$@" || return 0
    scripts/guest/run.sh "${machine[@]}" "$modules" "$program" --test-threads=1 --color=never "$@"
}

# vivid: /dev/video0 captures (inputs: a camera, HDMI, S-Video), and /dev/video1 is an HDMI output
# that can be looped back. Its controls inject faults.
in_guest guest_grabber "vivid n_devs=1 node_types=0x0101 num_inputs=3 input_types=0x2c num_outputs=1 output_types=0x1 no_error_inj=0" "$@"

# vhci: USB devices that the test itself simulates. The kernel takes one of them for a serial line.
in_guest guest_usb "vhci-hcd
usbserial vendor=0x0f44 product=0xff12" "$@"

# Both of the kernel's sides of USB: a gadget that is a serial line (ttyGS0), plugged into its own
# host (ttyACM0). And QEMU's FTDI adapter (ttyUSB0), which is connected to QEMU's second serial port
# (ttyS1) as by a null-modem cable.
machine=(
    --qemu -device --qemu qemu-xhci,id=xhci
    --qemu -chardev --qemu socket,id=near,path=cable,server=on,wait=off
    --qemu -chardev --qemu socket,id=far,path=cable
    --qemu -serial --qemu chardev:far
    --plugged adapter usb-serial,bus=xhci.0,chardev=near
)
in_guest guest_serial "xhci-pci
ftdi_sio
cdc-acm
dummy_hcd
usb_f_acm" "$@"

# Disks of the guest. The test runs on this machine, and boots guests itself.
if built guest_power "$@"; then
    SONOWEAVE_GUEST=$PWD/scripts/guest "$program" --test-threads=1 --color=never "$@"
fi

[ -n "$found" ] || {
    echo "hardware-test: no test has $* in its name" >&2
    exit 1
}
