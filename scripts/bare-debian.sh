# Makes a bare Debian in a folder. To be sourced by scripts that have functions `say` and `fail`.
# SONOWEAVE_DEBIAN_MIRROR names a mirror other than debootstrap's own choice.

# install_here PACKAGE COMMAND: installs a package on this machine if the command is missing.
install_here() {
    command -v "$2" >/dev/null || {
        say "installing $1"
        apt-get update -qq
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$1" >/dev/null
    }
}

# remove_machines PLACE NAME…: removes folders in PLACE, unless something is mounted there: the
# mount would be another's, as the scripts make theirs in namespaces that end with them.
remove_machines() {
    local place=$1 name
    shift
    if grep -qF " $place/" /proc/self/mountinfo; then
        say "$place holds a mount that this script did not make; it is left as it is" >&2
        return
    fi
    for name in "$@"; do rm -rf --one-file-system "${place:?}/$name"; done
}

# bare_debian ROOT LOG PACKAGE,PACKAGE,… [SUITE]: makes it with these packages, of Debian 12 or
# another suite. It has this machine's way to the network: names, certificates, proxies and apt's
# settings for fetching.
bare_debian() {
    local root=$1 log=$2 packages=$3 suite=${4:-bookworm} bundle
    install_here debootstrap debootstrap
    debootstrap --variant=minbase --include="$packages" "$suite" "$root" ${SONOWEAVE_DEBIAN_MIRROR:-} >"$log" 2>&1 || {
        tail -5 "$log" >&2
        fail "debootstrap failed; its log is $log"
    }
    cp -L /etc/resolv.conf /etc/hosts "$root/etc/"
    for bundle in /etc/ssl/certs/ca-certificates.crt "${SSL_CERT_FILE:-}"; do
        [ ! -f "$bundle" ] || install -D -m 644 "$bundle" "$root$bundle"
    done
    apt-config dump | grep -E '^Acquire::' >"$root/etc/apt/apt.conf.d/99this-machine" || true
}
