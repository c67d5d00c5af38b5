#!/usr/bin/env bash
# Tests `make demo`, both tutorials and `make test` on a bare Debian 12 with only git, make, curl
# and Rust. A machine without a compiler is made in a folder, and the last commit is cloned into
# it. All run there, once as root and once as an unprivileged user with sudo. `python` builds the
# wheel by the lines of docs/python.md instead, and runs a tutorial with it. `scale` runs `make
# scale`: volumes larger than memory, batches and clusters.
#
#   scripts/fresh-machine.sh [root|user|python|scale]...     root and user by default
#
# Needs root (chroot, mounts), network as this machine has it, 4 GB of disk and half an hour. The
# folder is target/fresh-machine, or the one that SONOWEAVE_FRESH_MACHINE names; it is removed at
# the end. SONOWEAVE_DEBIAN_MIRROR names a mirror other than debootstrap's own choice.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "fresh-machine: $*"; }
fail() {
    say "$*" >&2
    exit 1
}
. scripts/bare-debian.sh

[ "$(id -u)" -eq 0 ] || fail "needs root for chroot and mounts; run it with sudo -E"
who=("$@")
[ ${#who[@]} -gt 0 ] || who=(root user)
for name in "${who[@]}"; do
    case $name in root | user | python | scale) ;; *) fail "$name: must be root, user, python or scale" ;; esac
done

place=${SONOWEAVE_FRESH_MACHINE:-$PWD/target/fresh-machine}
mkdir -p "$place"
place=$(cd "$place" && pwd)
# Mounts are made in a namespace that ends with its process, so that removing folders cannot reach
# through one.
clean() { remove_machines "$place" base machine clone; }
trap clean EXIT
trap 'exit 1' INT TERM
clean

say "a bare Debian 12 in $place"
bare_debian "$place/base" "$place/debootstrap.log" git,make,curl,ca-certificates

say "this machine's Rust, and its way to the network"
toolchain=$(rustc --print sysroot)
mkdir -p "$place/base/opt/rust"
tar -C "$toolchain" --exclude=./share/doc --exclude=./lib/rustlib/src -cf - . | tar -C "$place/base/opt/rust" -xf -
carried=(PATH=/opt/rust/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8)
while IFS='=' read -r name value; do
    case $name in
    http_proxy | https_proxy | no_proxy | HTTP_PROXY | HTTPS_PROXY | NO_PROXY | SSL_CERT_FILE | SSL_CERT_DIR | CARGO_HTTP_* | CARGO_NET_* | PIP_*)
        carried+=("$name=$value")
        ;;
    esac
done < <(env)
[ ! -f /etc/pip.conf ] || cp /etc/pip.conf "$place/base/etc/"
cargo_config=${CARGO_HOME:-$HOME/.cargo}/config.toml

say "the last commit, $(git rev-parse --short HEAD)"
git clone -q --no-hardlinks "$PWD" "$place/clone"

run_as() {
    local name=$1 home began root=$place/machine
    rm -rf --one-file-system "$root"
    cp -a "$place/base" "$root"
    if [ -e "$root/usr/bin/cc" ] || [ -e "$root/usr/bin/gcc" ]; then fail "the machine is not bare: it has a compiler"; fi
    home=/root
    if [ "$name" = user ]; then
        home=/home/maker
        chroot "$root" useradd --create-home --shell /bin/bash maker
        chroot "$root" env DEBIAN_FRONTEND=noninteractive sh -c 'apt-get update -qq && apt-get install -y -qq --no-install-recommends sudo' \
            >"$place/sudo.log" 2>&1 || fail "sudo could not be installed; the log is $place/sudo.log"
        echo 'maker ALL=(ALL) NOPASSWD: ALL' >"$root/etc/sudoers.d/maker"
        # The setup step must fetch its own package lists.
        rm -rf "$root/var/lib/apt/lists"
    fi
    cp -a "$place/clone" "$root$home/sonoweave"
    [ ! -f "$cargo_config" ] || install -D -m 644 "$cargo_config" "$root$home/.cargo/config.toml"
    [ "$name" != user ] || chroot "$root" chown -R maker: "$home"
    tasks=(demo replay calibrate test)
    [ "$name" != scale ] || tasks=(scale)
    if [ "$name" = python ]; then
        # The page asks for them.
        chroot "$root" env DEBIAN_FRONTEND=noninteractive sh -c \
            'apt-get update -qq && apt-get install -y -qq --no-install-recommends python3-venv gcc libc6-dev' \
            >"$place/python.log" 2>&1 || fail "python3-venv could not be installed; the log is $place/python.log"
        tasks=(python)
    fi
    for task in "${tasks[@]}"; do
        began=$SECONDS
        case $task in
        demo) set -- make --no-print-directory demo DURATION=12 ;;
        test | scale) set -- make --no-print-directory "$task" ;;
        # The lines under "By hand", and the first tutorial with a sweep of this commit's program.
        python) set -- sh -euc 'commands=$(awk "/^By hand/{ on = 1 } on && /^\`\`\`/{ n++; next } n == 1" docs/python.md)
            printf "set -x\n%s\n" "$commands" | sh -eu
            venv/bin/pip install --quiet matplotlib
            cargo build --release --locked --bin sonoweave
            target/release/sonoweave phantom -o ../sweep.igs.mha --trajectory freehand
            cp python/tutorials/offline.py ..
            (cd .. && sonoweave/venv/bin/python offline.py sweep.igs.mha)
            test -s ../plot.png' ;;
        # The commands of a page's tutorial, with the program that `make demo` has built.
        *) set -- sh -euc 'mkdir "../$0"
            commands=$(awk "/^## /{ on = /Step by step/ } on && sub(/^[$] /, \"\")" "docs/$0.md")
            export PATH="$PWD/target/release:$PATH"
            cd "../$0"
            printf "set -x\n%s\n" "$commands" | sh -eu' "$task" ;;
        esac
        say "== $name: $task"
        unshare --mount --pid --fork --kill-child --propagation private bash -euc '
            root=$1 name=$2 home=$3
            shift 3
            mount -t proc proc "$root/proc"
            mount --rbind /dev "$root/dev"
            # Slurm asks for the control groups there.
            mount --rbind /sys "$root/sys"
            set -- env -i HOME="$home" "$@"
            if [ "$name" = user ]; then
                exec chroot --userspec=maker:maker "$root" "$@"
            fi
            exec chroot "$root" "$@"
        ' fresh-machine "$root" "$name" "$home" "${carried[@]}" env --chdir="$home/sonoweave" "$@"
        say "== $name: $task passed in $((SECONDS - began)) s"
    done
    # A compiler was missing, so the setup step must have installed one.
    [ -e "$root/usr/bin/cc" ] || fail "all passed without a compiler; what did they build?"
}

for name in "${who[@]}"; do
    run_as "$name"
done
say "passed as ${who[*]}"
