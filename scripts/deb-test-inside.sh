#!/bin/bash
# Tests the installed package in the booted container of scripts/deb-test.sh. Every wait has a time
# limit, far beyond the usual time.
set -euo pipefail

# check NAME COMMAND…: runs a command; if it fails, prints its output and ends all.
check() {
    local what=$1
    shift
    if "$@" >/tmp/said 2>&1; then
        echo "  ok: $what"
    else
        echo "  NOT: $what: $*"
        cat /tmp/said
        journalctl --no-pager -u sonoweave -n 40 || true
        exit 1
    fi
}
# within SECONDS COMMAND…: repeats a command until it succeeds or the time is over.
within() {
    local end=$((SECONDS + $1))
    shift
    until "$@" >/tmp/tried 2>&1; do
        [ $SECONDS -lt $end ] || {
            cat /tmp/tried
            return 1
        }
        sleep 0.2
    done
}
is() { [ "$1" = "$2" ] || {
    echo "$1 and not $2"
    return 1
}; }
shown() { is "$(systemctl show --value -p "$1" sonoweave)" "$2"; }
silent() {
    "$@" >/tmp/words 2>&1 || true
    [ ! -s /tmp/words ] || {
        cat /tmp/words
        return 1
    }
}

commands=$(sonoweave --help | sed -n '/^Commands:/,/^$/s/^  \([a-z]\+\) .*/\1/p' | grep -v help)
[ "$(echo "$commands" | wc -l)" -ge 8 ] || exit 1
# Warnings about macros of others are ignored; those about characters that cannot be set count.
set_by_groff() { silent sh -c 'man --warnings -E UTF-8 -l -Tutf8 -Z "$1" 2>&1 >/dev/null' sh "$1"; }
for page in sonoweave $(printf 'sonoweave-%s ' $commands) sonoweave-bedside; do
    check "man $page" man -w "$page"
    check "$page is set without a warning" set_by_groff "$(man -w "$page")"
done

completes() {
    source /usr/share/bash-completion/completions/sonoweave
    COMP_WORDS=("${@:2}") COMP_CWORD=$(($# - 2)) COMPREPLY=()
    _sonoweave sonoweave "${!#}" "${COMP_WORDS[COMP_CWORD - 1]}"
    [[ " ${COMPREPLY[*]} " == *" $1 "* ]] || {
        echo "offered: ${COMPREPLY[*]}"
        return 1
    }
}
check "bash offers commands" completes live sonoweave li
check "bash offers flags" completes --config sonoweave live --con
check "bash offers values" completes virtual sonoweave live --example vir
check "zsh reads its completions" zsh -n /usr/share/zsh/vendor-completions/_sonoweave
check "fish reads its completions" fish --no-execute /usr/share/fish/vendor_completions.d/sonoweave.fish

rules=/usr/lib/udev/rules.d/70-sonoweave.rules
# Debian 12's udev has no `verify`, but reports faulty rules when it reads them for a device.
understood() {
    if udevadm verify --help >/dev/null 2>&1; then
        udevadm verify "$1"
    else
        SYSTEMD_LOG_LEVEL=debug udevadm test /sys/class/mem/null 2>&1 | grep -F "${1##*/}" >/tmp/read
        grep -qi "reading rules file" /tmp/read && silent grep -E "${1##*/}:[0-9]+" /tmp/read
    fi
}
check "udev understands the rules" understood $rules
cmp <(sonoweave devices --udev) $rules
sed 's/SUBSYSTEM==/SUBSISTEM==/' $rules >/etc/udev/rules.d/71-broken.rules
if understood /etc/udev/rules.d/71-broken.rules >/dev/null; then
    echo "  NOT: a broken rule is noticed"
    exit 1
fi
rm /etc/udev/rules.d/71-broken.rules

fleet=/usr/share/doc/sonoweave/examples/fleet
listed() { is "$(cd $fleet && find . -type f | sed 's|targets/.*|targets/*.json|' | LC_ALL=C sort | xargs -n1 basename | xargs)" "$1"; }
check "the files of a fleet are those of the page" listed "agent.yml dashboard.json prometheus.yml rules.yml rules_test.yml *.json"

check "systemd understands the unit" silent systemd-analyze verify sonoweave.service
check "the service is not enabled" is "$(systemctl is-enabled sonoweave || true)" disabled
check "its user has the devices' groups" is "$(id -Gn sonoweave | tr ' ' '\n' | sort | xargs)" "dialout plugdev sonoweave video"

# The shipped configuration has no calibration.
refuses() { ! systemctl start sonoweave && journalctl --no-pager -u sonoweave | grep "$1"; }
check "without a calibration it refuses, and says so" refuses 'calibrate probe'
systemctl stop sonoweave
# A unit that systemd has forgotten has no failures.
systemctl reset-failed sonoweave 2>/dev/null || true
# With one, and without its hardware.
sed 's/^provenance = .*/provenance = "a test"/' /usr/share/doc/sonoweave/examples/probe.toml >/etc/sonoweave/probe.toml
sed -i 's/^#file = "probe.toml".*/file = "probe.toml"/' /etc/sonoweave/bedside.toml
check "it starts without its hardware" systemctl start sonoweave
status() {
    exec 3<>"/dev/tcp/127.0.0.1/9110"
    printf 'GET %s HTTP/1.1\r\nHost: 127.0.0.1:9110\r\nConnection: close\r\n\r\n' "$1" >&3
    cat <&3 >/tmp/answer
    exec 3>&-
    grep -q "$2" /tmp/answer || {
        cat /tmp/answer
        return 1
    }
}
check "and says that it is absent" within 30 status /status '"absent"'
check "it stops" systemctl stop sonoweave
check "well" shown Result success

# At a virtual bedside.
rm /etc/sonoweave/probe.toml
{
    cat /virtual.toml
    printf '\n[record]\nfolder = "/var/lib/sonoweave/sessions"\n\n[status]\nlisten = "127.0.0.1:9110"\n'
} >/etc/sonoweave/bedside.toml
rm -rf /var/lib/sonoweave/sessions
check "it is enabled and starts" systemctl enable --now sonoweave
check "it is active" shown ActiveState active
check "as its user" is "$(ps -o user= -p "$(systemctl show --value -p MainPID sonoweave)")" sonoweave
grows() { [ "$(stat -c %s "$1")" -gt 1000000 ]; }
first=$(ls /var/lib/sonoweave/sessions/*.mcap)
check "a session grows" within 60 grows "$first"
check "which others cannot read" is "$(stat -c '%a %U %G' "$first")" "640 sonoweave sonoweave"
check "metrics are told" status /metrics sonoweave_
main=$(systemctl show --value -p MainPID sonoweave)
# Raising limits needs CAP_SYS_RESOURCE, which not every machine gives its root.
if (($((16#$(sed -n 's/^CapEff:\t//p' /proc/1/status))) >> 24 & 1)); then
    check "it may have real time" grep -E '^Max realtime priority +20 ' "/proc/$main/limits"
    check "and lock its memory" grep -E '^Max locked memory +unlimited ' "/proc/$main/limits"
else
    echo "  not tried: whether it may have real time and lock its memory, as this machine lets nobody raise a limit"
fi
sed -i 's/^image_size = .*/image_size = "256x256"/' /etc/sonoweave/bedside.toml
check "it is reloaded" systemctl reload sonoweave
check "and says so" within 20 sh -c 'journalctl --no-pager -u sonoweave | grep -q "the configuration was read again"'
check "and goes on" is "$(systemctl show --value -p ActiveState,MainPID sonoweave | xargs)" "$main active"
check "it stops" systemctl stop sonoweave
check "well" shown Result success
check "by itself" shown ExecMainStatus 0
check "the session is whole" sh -c 'sonoweave inspect "$1" | tee /tmp/session; ! grep -qi "broken off" /tmp/session' sh "$first"
check "and has pictures" grep -E '^  image +[1-9][0-9]+, ' /tmp/session

sleep 1
check "it starts again" systemctl start sonoweave
is_back() { [ "$(systemctl show --value -p NRestarts sonoweave)" = 1 ] && shown ActiveState active; }
systemctl kill --signal=KILL sonoweave
check "killed, it is back" within 60 is_back
check "in a session of its own" within 30 sh -c '[ "$(ls /var/lib/sonoweave/sessions | wc -l)" -eq 3 ]'
check "it stops" systemctl stop sonoweave
