#!/usr/bin/env bash
# Fetches the parts of the guest into out/guest: Debian's kernel with its modules, busybox, and QEMU
# and mkfs.ext4 if the machine has none. Nothing is installed and nothing needs root: packages are
# downloaded, checked by apt against its signed lists, and unpacked. Complete packages are not
# fetched again; `rm -r out/guest` renews them.
set -euo pipefail
cd "$(dirname "$0")/../.."

place=$PWD/out/guest
tree=$place/tree
say() { echo "guest: $*"; }
fail() {
    say "$*" >&2
    exit 1
}

[ "$(uname -m)" = x86_64 ] || fail "the guest is an x86-64 machine made of this one's packages, and this is $(uname -m); run the hardware tests on x86-64"
for tool in apt-get apt-cache dpkg; do
    command -v "$tool" >/dev/null || fail "$tool is not there; the guest is made of Debian's packages, so run the hardware tests on Debian 12 or later"
done

# Tools of the system are not in everyone's path.
export PATH=$PATH:/usr/sbin:/sbin
has_mkfs() { command -v mkfs.ext4 >/dev/null || [ -x "$tree/sbin/mkfs.ext4" ]; }
if [ -f "$place/ready" ] && has_mkfs && (cd "$place/packages" && sha256sum --check --quiet SHA256SUMS) 2>/dev/null; then
    say "made of the packages in out/guest/packages, whose checksums are right"
    exit 0
fi
rm -rf "$place"
mkdir -p "$place/packages"

# The machine's package lists, or fresh ones in out/guest if those are missing or outdated.
apt_options=()
own_lists() {
    say "fetching package lists into out/guest/apt"
    mkdir -p "$place/apt/lists/partial" "$place/apt/cache/archives/partial"
    apt_options=(-o "Dir::State::Lists=$place/apt/lists" -o "Dir::Cache=$place/apt/cache" -o Debug::NoLocking=1)
    apt-get "${apt_options[@]}" -qq update >"$place/apt.log" 2>&1 ||
        fail "the package lists cannot be fetched, so that there is no kernel to test with; see out/guest/apt.log and the machine's way to its Debian mirror"
}
kernel_package() {
    apt-cache "${apt_options[@]}" depends linux-image-amd64 2>/dev/null | sed -n 's/^ *Depends: \(linux-image-[0-9].*\)$/\1/p' | head -n 1
}
# added_by PACKAGE…: prints the packages that installing these would add to the machine.
added_by() {
    apt-get "${apt_options[@]}" install --simulate --no-install-recommends "$@" 2>>"$place/apt.log" | sed -n 's/^Inst \([^ ]*\) .*/\1/p'
}
download() {
    local kernel names=(busybox-static)
    kernel=$(kernel_package)
    [ -n "$kernel" ] || return 1
    names+=("$kernel")
    command -v xz >/dev/null || names+=(xz-utils)
    if ! command -v mkfs.ext4 >/dev/null; then
        mapfile -t -O "${#names[@]}" names < <(added_by e2fsprogs)
        [[ " ${names[*]} " == *" e2fsprogs "* ]] || return 1
    fi
    if ! command -v qemu-system-x86_64 >/dev/null; then
        mapfile -t -O "${#names[@]}" names < <(added_by qemu-system-x86)
        [[ " ${names[*]} " == *" qemu-system-x86 "* ]] || return 1
    fi
    say "fetching $kernel and ${#names[@]} packages in all"
    (cd "$place/packages" && apt-get "${apt_options[@]}" -qq download "${names[@]}" >>"$place/apt.log" 2>&1)
}
download || { own_lists && download; } ||
    fail "Debian's kernel package (linux-image-amd64) or what it needs cannot be fetched, so that there is no kernel to test with; see out/guest/apt.log"
(cd "$place/packages" && sha256sum -- *.deb >SHA256SUMS)

mkdir -p "$tree"
for package in "$place"/packages/*.deb; do
    dpkg --extract "$package" "$tree"
done

# An unpacked kernel boots in a third of the time.
image=$(echo "$tree"/boot/vmlinuz-*)
xz=$(command -v xz || echo "$tree/usr/bin/xz")
# The compressed part begins at the magic number, and other data follow it.
LC_ALL=C grep --only-matching --byte-offset --binary --text --max-count=1 --perl-regexp '\xfd7zXZ\x00' "$image" | cut -d: -f1 | while read -r at; do
    tail -c "+$((at + 1))" "$image" | "$xz" --decompress --stdout --single-stream >"$place/vmlinux" 2>/dev/null && break
done || true
[ "$(head -c 4 "$place/vmlinux" | tail -c 3)" = ELF ] || fail "$(basename "$image") holds no kernel compressed by xz; the packing has changed, see scripts/guest/prepare.sh"

basename "$tree"/lib/modules/* >"$place/ready"
say "made of $(cat "$place/ready"), $(du -sh "$place/packages" | cut -f1) of packages"
