#!/usr/bin/env bash
# Tests the package of scripts/deb.sh on a bare Debian 12 in a folder. It is made twice with the
# same bytes, installs with its dependencies, and is accepted by man, shells, udev and systemd. In a
# booted container its service records a session, and is reloaded, stopped, killed and restarted.
# After removal settings and sessions are left, after a purge only sessions.
#
# Needs root (chroot, containers), network as this machine has it, 1 GB of disk and two minutes
# beside the building. The folder is target/deb-test, or the one that SONOWEAVE_DEB_TEST names; it
# is removed at the end. `lintian` is run if it is installed.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "deb-test: $*"; }
fail() {
    say "$*" >&2
    exit 1
}
. scripts/bare-debian.sh

[ "$(id -u)" -eq 0 ] || fail "needs root for chroot and a container; run it with sudo -E"
place=${SONOWEAVE_DEB_TEST:-$PWD/target/deb-test}
mkdir -p "$place"
place=$(cd "$place" && pwd)
clean() { remove_machines "$place" machine first second; }
trap clean EXIT
trap 'exit 1' INT TERM
clean

say "== the package, made twice: by day and by night, by different habits"
scripts/deb.sh "$place/first"
(umask 077 && TZ=Pacific/Auckland LC_ALL=C scripts/deb.sh "$place/second" >/dev/null)
package=$(echo "$place"/first/*.deb)
cmp "$package" "$place/second/${package##*/}" || fail "the same source gave another package the second time"
say "the same bytes"
if command -v lintian >/dev/null; then
    say "== lintian"
    # The package is not Debian's: it closes none of their bugs, and its maintainer is not theirs.
    lintian --allow-root --fail-on error,warning "$package" \
        --suppress-tags initial-upload-closes-no-bugs,bogus-mail-host,bogus-mail-host-in-debian-changelog ||
        fail "lintian has found something"
    say "nothing to complain about"
fi

root=$place/machine
in_machine() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive "$@"; }
# The installed files, without those that change by themselves.
listing() { (cd "$root" && find etc usr var home opt srv -path var/cache -prune -o -path var/lib/apt -prune -o -path var/lib/dpkg -prune -o -path var/log -prune -o -print | LC_ALL=C sort); }
quietly() { "$@" >"$place/log" 2>&1 || {
    cat "$place/log" >&2
    fail "failed: $*"
}; }

say "== a bare Debian 12 in $place"
bare_debian "$root" "$place/debootstrap.log" ca-certificates
cp "$package" "$root/sonoweave.deb"
quietly in_machine apt-get update -qq
say "== installed with what it says it needs, and nothing else"
quietly in_machine apt-get install -y --no-install-recommends /sonoweave.deb
in_machine sonoweave --version
in_machine id sonoweave
# No example of a calibration is installed as one, and the configuration asks for the bedside's own.
[ "$(ls "$root/etc/sonoweave")" = bedside.toml ] || fail "/etc/sonoweave holds more than the configuration"
! in_machine sonoweave live --config /etc/sonoweave/bedside.toml --duration 1 2>"$place/log" || fail "a session began without a calibration"
grep -F "sonoweave calibrate probe --live" "$place/log" || fail "nobody said that the calibration is missing: $(cat "$place/log")"
quietly in_machine apt-get purge -y sonoweave

say "== installed beside udev, man, systemd and shells"
quietly in_machine apt-get install -y --no-install-recommends systemd-sysv udev man-db zsh fish
listing >"$place/before"
quietly in_machine apt-get install -y --no-install-recommends /sonoweave.deb
[ ! -e "$root/etc/systemd/system/multi-user.target.wants/sonoweave.service" ] || fail "the service was enabled, and nobody had asked"

say "== booted"
install_here systemd-container systemd-nspawn
install -m 755 scripts/deb-test-inside.sh "$root/deb-test-inside.sh"
in_machine sonoweave live --example virtual >"$root/virtual.toml"
cat >"$root/etc/systemd/system/deb-test.service" <<'END'
[Unit]
SuccessAction=exit
FailureAction=exit
[Service]
Type=oneshot
ExecStart=/deb-test-inside.sh
StandardOutput=append:/deb-test.log
StandardError=append:/deb-test.log
TimeoutStartSec=300
END
mkdir -p "$root/etc/systemd/system/multi-user.target.wants"
ln -s ../deb-test.service "$root/etc/systemd/system/multi-user.target.wants/deb-test.service"
# Its network has only loopback.
passed=yes
timeout 400 systemd-nspawn --quiet --directory="$root" --private-network --register=no --keep-unit --console=pipe --boot \
    </dev/null >"$place/boot.log" 2>&1 || passed=
[ ! -f "$root/deb-test.log" ] || cat "$root/deb-test.log"
[ -n "$passed" ] || {
    tail -20 "$place/boot.log" >&2
    fail "it did not pass in the container; what the container said is in $place/boot.log"
}

say "== removed, while it is enabled"
rm "$root/etc/systemd/system/multi-user.target.wants/deb-test.service" "$root/etc/systemd/system/deb-test.service"
# Other files may come from the container's own boot.
listing | grep -E 'sonoweave' >"$place/installed"
sessions=$(ls "$root/var/lib/sonoweave/sessions")
quietly in_machine apt-get remove -y sonoweave
left() { listing | grep -F sonoweave; }
settings=$(printf '%s\n' etc/sonoweave etc/sonoweave/bedside.toml)
recorded=$({
    printf '%s\n' var/lib/sonoweave var/lib/sonoweave/sessions
    printf 'var/lib/sonoweave/sessions/%s\n' $sessions
} | LC_ALL=C sort)
[ "$(left)" = "$settings"$'\n'"$recorded" ] || {
    left >&2
    fail "these are left, which are more or less than the settings and sessions"
}
say "settings and sessions are left"
quietly in_machine apt-get purge -y sonoweave
grep -F "stays in /var/lib/sonoweave" "$place/log" || fail "nobody said what became of the sessions"
[ "$(left)" = "$recorded" ] || {
    left >&2
    fail "these are left, which are more or less than the sessions"
}
say "purged; sessions are left"
quietly in_machine apt-get install -y --no-install-recommends /sonoweave.deb
rm -r "$root/var/lib/sonoweave/sessions"
quietly in_machine apt-get purge -y sonoweave
[ -z "$(left)" ] || fail "without sessions something is left: $(left)"
say "passed"
