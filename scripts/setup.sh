#!/bin/sh
# Installs the Debian packages that building and testing need and the machine lacks. Rust must be
# there (https://rustup.rs).
#
#   scripts/setup.sh [package|release|arm64|interop|console|python|igsio]
#
# package: the tools that make a Debian package.
# release: those, those of arm64, the C compiler for static programs, and Rust's library for them,
#   by rustup.
# arm64: the compiler for arm64, Rust's library for its static programs, and an emulator.
# interop: Python environments, a verifier and an archive for DICOM, OpenIGTLink's reference
#   library, and Prometheus. Debian starts the services of archive and Prometheus on systems with
#   systemd; `systemctl disable --now orthanc prometheus` ends them.
# console: a browser, and node to drive it.
# igsio: a C++ compiler, and VTK's headers and libraries, which IGSIO's source needs.
# python: the module that makes Python environments, and Slurm, whose services do not start
#   without a configuration.
set -eu

command -v cargo >/dev/null 2>&1 || {
    echo "setup: cargo was not found. Install Rust (rustup, or Debian's rustup package), then run make again." >&2
    exit 1
}

missing=""
# need PACKAGE FILE: the package is there if the file is.
need() { [ -e "$2" ] || missing="$missing $1"; }
command -v cc >/dev/null 2>&1 || missing="$missing gcc"
need libc6-dev /usr/include/stdlib.h
case ${1:-} in package | release) need dpkg-dev /usr/bin/dpkg-shlibdeps ;; esac
# library TARGET: Rust's library for it.
library() {
    [ -d "$(rustc --print target-libdir --target "$1")" ] || rustup target add "$1" || {
        echo "setup: Rust's library for $1 is needed and could not be installed; see \`rustup target add\`" >&2
        exit 1
    }
}
if [ "${1:-}" = release ]; then
    need musl-tools /usr/bin/musl-gcc
    library "$(rustc -vV | sed -n 's/^host: \(.*\)-gnu$/\1-musl/p')"
fi
case ${1:-} in
release | arm64)
    need gcc-aarch64-linux-gnu /usr/bin/aarch64-linux-gnu-gcc
    need libc6-dev-arm64-cross /usr/aarch64-linux-gnu/include/stdlib.h
    need qemu-user /usr/bin/qemu-aarch64
    library aarch64-unknown-linux-musl
    ;;
esac
# Debian's Python lacks the module that makes environments.
case ${1:-} in interop | python) python3 -c 'import ensurepip, venv' 2>/dev/null || missing="$missing python3-venv" ;; esac
[ "${1:-}" != python ] || need slurm-client /usr/bin/sbatch
[ "${1:-}" != python ] || need slurmctld /usr/sbin/slurmctld
[ "${1:-}" != python ] || need slurmd /usr/sbin/slurmd
[ "${1:-}" != interop ] || need dicom3tools /usr/bin/dciodvfy
[ "${1:-}" != interop ] || need orthanc /usr/sbin/Orthanc
[ "${1:-}" != interop ] || need prometheus /usr/bin/promtool
[ "${1:-}" != interop ] || need openssl /usr/bin/openssl
case ${1:-} in interop | igsio) command -v c++ >/dev/null 2>&1 || missing="$missing g++" ;; esac
[ "${1:-}" != interop ] || need libopenigtlink-dev /usr/include/openigtlink/igtlClientSocket.h
[ "${1:-}" != igsio ] || [ -e "$(echo /usr/include/vtk-*/vtkImageData.h)" ] || missing="$missing libvtk9-dev"
if [ "${1:-}" = console ]; then
    # A node of another source is kept, as Debian's conflicts with it.
    command -v node >/dev/null 2>&1 || missing="$missing nodejs"
    command -v npm >/dev/null 2>&1 || missing="$missing npm"
    need chromium /usr/bin/chromium
fi

[ -n "$missing" ] || exit 0
command -v apt-get >/dev/null 2>&1 || {
    echo "setup: Debian's packages$missing, or what another system has in their place, are needed; install them, then run make again." >&2
    exit 1
}
as_root=""
if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null 2>&1 || {
        echo "setup: these Debian packages are missing and need root to install:$missing" >&2
        exit 1
    }
    as_root="sudo"
fi
echo "setup: installing Debian packages:$missing${as_root:+ (with sudo)}"
# sudo drops the caller's variables, so they are set after it.
$as_root env DEBIAN_FRONTEND=noninteractive apt-get update -qq
$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing
