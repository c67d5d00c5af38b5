#!/usr/bin/env bash
# Tests a release. It is made here and in a clone in another folder, by another user's habits, with
# the same bytes. The program of the tarball names no path of this machine and needs no library. It
# runs a demo, replays it and reconstructs a sweep on a bare Debian 12, on another Debian, and in an
# empty folder. Nothing is installed there, and the bits are those of the package's program.
#
#   scripts/release-test.sh
#
# Needs root (chroot, mounts), network as this machine has it, 5 GB of disk, and the time of two
# builds. The folder is target/release-test, or the one that SONOWEAVE_RELEASE_TEST names; it is
# removed at the end. SONOWEAVE_OTHER_DEBIAN is the other Debian, trixie by default.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "release-test: $*"; }
fail() {
    say "$*" >&2
    exit 1
}
. scripts/bare-debian.sh

[ "$(id -u)" -eq 0 ] || fail "needs root for chroot and mounts; run it with sudo -E"
[ -z "$(git status --porcelain --untracked-files=no)" ] || fail "the sources have changes that are not committed; a clone lacks them"
other=${SONOWEAVE_OTHER_DEBIAN:-trixie}
place=${SONOWEAVE_RELEASE_TEST:-$PWD/target/release-test}
mkdir -p "$place"
place=$(cd "$place" && pwd)
clean() { remove_machines "$place" "a clone" bookworm "$other" empty here wheel arm64; }
trap clean EXIT
trap 'exit 1' INT TERM
clean

say "== the release, here and in another folder"
scripts/release.sh
git clone -q --no-hardlinks "$PWD" "$place/a clone"
(umask 077 && export TZ=Pacific/Auckland LC_ALL=C USER=somebody && cd "$place/a clone" && scripts/release.sh)
diff -r out/release "$place/a clone/out/release" || fail "the same commit gave other files in another folder"
(cd out/release && sha256sum --quiet --check SHA256SUMS)
say "the same bytes: $(cd out/release && ls | wc -l) files"

mkdir "$place/empty"
tar -C "$place/empty" --strip-components=1 -xf "out/release/"*"-$(uname -m)-"*.tar.gz
program=$place/empty/sonoweave
for word in "$PWD" "$HOME" "$place"; do
    ! grep -qaF -- "$word" "$program" || fail "the program contains the path $word"
done
say "no path of this machine in the program"
python3 -m zipfile -e out/release/*.whl "$place/wheel"
for word in "$PWD" "$HOME" "$place"; do
    ! grep -rqaF -- "$word" "$place/wheel" || fail "the wheel contains the path $word"
done
say "no path of this machine in the wheel"
! readelf -ld "$program" | grep -E 'INTERP|NEEDED' || fail "the program needs a loader or a library"

# Each command's result is compared by its bytes.
commands='set -eu
cd /tmp
sonoweave=$1
$sonoweave --version
$sonoweave demo --headless --duration 4 -o demo >log 2>&1 || { cat log; exit 1; }
$sonoweave replay demo/SESSION-*.mcap -o again.mha >log 2>&1 || { cat log; exit 1; }
cmp demo/volume.mha again.mha
$sonoweave replay /sample/session.mcap -o sample.mha >log 2>&1 || { cat log; exit 1; }
$sonoweave phantom -o sweep.igs.mha --scene blobs --seed 1 >log 2>&1 || { cat log; exit 1; }
$sonoweave reconstruct sweep.igs.mha -o sweep.mha >log 2>&1 || { cat log; exit 1; }
$sonoweave render sweep.mha -o sweep.png >log 2>&1 || { cat log; exit 1; }
sha256sum sweep.mha sweep.png'
# in_root NAME COMMAND…: runs a command in a folder, whose mounts end with it.
in_root() {
    local root=$place/$1
    shift
    mkdir -p "$root/tmp" "$root/proc" "$root/dev"
    unshare --mount --pid --fork --kill-child --propagation private bash -euc '
        root=$1
        shift
        mount -t proc proc "$root/proc"
        mount --rbind /dev "$root/dev"
        exec env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin chroot "$root" "$@"
    ' release-test "$root" "$@"
}
try() {
    local name=$1
    say "== $name: $(sed -n 's/^PRETTY_NAME=//p' "$place/$name/etc/os-release")"
    cp -r "$program" "$place/empty/sample" "$place/$name/"
    in_root "$name" sh -c "$commands" sh /sonoweave | tee "$place/$name/said"
}
bare_debian "$place/bookworm" "$place/bookworm.log" ca-certificates
try bookworm
bare_debian "$place/$other" "$place/$other.log" ca-certificates "$other"
try "$other"
cmp "$place/bookworm/said" "$place/$other/said" || fail "the results differ from Debian to Debian"

say "== a folder with nothing but the release"
in_root empty /sonoweave demo --headless --duration 4 -o /tmp/demo
in_root empty /sonoweave phantom -o /tmp/sweep.igs.mha --scene blobs --seed 1
in_root empty /sonoweave reconstruct /tmp/sweep.igs.mha -o /tmp/sweep.mha
grep -qF "$(sha256sum <"$place/empty/tmp/sweep.mha" | cut -d' ' -f1)" "$place/bookworm/said" || fail "the results differ"

say "== the package's program has the same bits"
mkdir "$place/here"
dpkg-deb --extract "out/release/"*"_$(dpkg --print-architecture).deb" "$place/here"
"$place/here/usr/bin/sonoweave" phantom -o "$place/here/sweep.igs.mha" --scene blobs --seed 1
"$place/here/usr/bin/sonoweave" reconstruct "$place/here/sweep.igs.mha" -o "$place/here/sweep.mha"
grep -qF "$(sha256sum <"$place/here/sweep.mha" | cut -d' ' -f1)" "$place/bookworm/said" || fail "the results differ"
say "== the programs for arm64, in an emulator, have the same bits"
mkdir "$place/arm64"
tar -C "$place/arm64" --strip-components=1 -xf out/release/*-aarch64-*.tar.gz
dpkg-deb --extract out/release/*_arm64.deb "$place/arm64"
for program in "$place/arm64/sonoweave" "$place/arm64/usr/bin/sonoweave"; do
    qemu-aarch64 "$program" phantom -o "$place/arm64/sweep.igs.mha" --scene blobs --seed 1
    qemu-aarch64 "$program" reconstruct "$place/arm64/sweep.igs.mha" -o "$place/arm64/sweep.mha"
    grep -qF "$(sha256sum <"$place/arm64/sweep.mha" | cut -d' ' -f1)" "$place/bookworm/said" || fail "the results differ"
done
say "passed"
