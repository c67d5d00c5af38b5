#!/usr/bin/env bash
# Boots the guest, loads kernel modules in it and runs a program there. The program's exit code is
# this script's.
#
#   scripts/guest/run.sh [--qemu ARGUMENT]... [--plugged ID DEVICE]... MODULES PROGRAM [ARGUMENT]...
#
# MODULES are lines of a module's name and its parameters. Modules that they depend on are loaded
# before them. The program may be dynamically linked: its libraries are copied with it.
# SONOWEAVE_GUEST_SECONDS (240) is the time limit, which includes QEMU's start.
#
# --qemu is a further argument of QEMU, which runs in a folder of its own. --plugged is a device of
# QEMU (its name and properties) that is plugged in. The program unplugs it by a line
# GUEST-UNPLUG:ID, and plugs it in again by GUEST-PLUG:ID.
#
# By a line GUEST-CUT:MS the program asks for a power cut after so many milliseconds: QEMU is
# killed. The exit code is then 0.
set -euo pipefail
machine=()
declare -A plugged
while [[ ${1-} == --* ]]; do
    case $1 in
    --qemu)
        machine+=("$2")
        shift 2
        ;;
    --plugged)
        machine+=(-device "$3,id=$2")
        plugged[$2]=$3
        shift 3
        ;;
    *)
        echo "guest: there is no option $1" >&2
        exit 2
        ;;
    esac
done
modules=$1
program=$2
shift 2
cd "$(dirname "$0")/../.."

place=$PWD/out/guest
tree=$place/tree
version=$(cat "$place/ready")
kernel=$tree/lib/modules/$version/kernel
root=$(mktemp -d "$place/root.XXXXXX")
trap 'rm -rf "$root"' EXIT
fail() {
    echo "guest: $*" >&2
    exit 1
}

mkdir -p "$root"/{bin,dev,dev/pts,proc,sys,tmp,modules,lib64}
cp "$tree/bin/busybox" "$root/bin/busybox"
cp scripts/guest/init "$root/init"
cp "$program" "$root/program"
# Tests recognise the guest by this file.
touch "$root/sonoweave-guest"

# The program's libraries, where its loader looks for them.
ldd "$program" 2>/dev/null | grep -o '/[^ ]*' | while read -r library; do
    mkdir -p "$root$(dirname "$library")"
    cp --dereference "$library" "$root$library"
done

# load NAME PARAMETER…: puts a module into the load order, after the modules that it names as its
# dependencies.
loaded=" "
load() {
    local name=$1 file pattern of
    shift
    [[ $loaded != *" ${name//-/_} "* ]] || return 0
    pattern=$(echo "$name" | sed 's/[-_]/[-_]/g')
    file=$(find "$kernel" -name "$pattern.ko" | head -n 1)
    if [ -z "$file" ]; then
        # The module may be built into the kernel.
        grep -q "/$pattern\.ko$" "$tree/lib/modules/$version/modules.builtin" || fail "the kernel $version has no module $name"
        return 0
    fi
    for of in $(LC_ALL=C tr '\0' '\n' <"$file" | sed -n 's/^depends=//p' | tr ',' ' '); do
        load "$of"
    done
    loaded="$loaded${name//-/_} "
    cp "$file" "$root/modules/"
    echo "/modules/$(basename "$file") $*" >>"$root/modules/order"
}
: >"$root/modules/order"
while read -r name parameters; do
    [ -z "$name" ] || load "$name" "$parameters"
done <<<"$modules"

(cd "$root" && find . | "$tree/bin/busybox" cpio -o -H newc -R 0:0) >"$root.cpio" 2>/dev/null
trap 'rm -rf "$root" "$root.cpio"' EXIT

qemu=$(command -v qemu-system-x86_64 || true)
data=()
if [ -z "$qemu" ]; then
    qemu=$tree/usr/bin/qemu-system-x86_64
    data=(-L "$tree/usr/share/qemu" -L "$tree/usr/share/seabios")
    export LD_LIBRARY_PATH=$tree/usr/lib/x86_64-linux-gnu:$tree/lib/x86_64-linux-gnu
fi
log=$(mktemp "$place/log.XXXXXX")
# QEMU's monitor, which plugs devices in and out.
mkfifo "$root/monitor.in" "$root/monitor.out"
# cut MILLISECONDS: kills QEMU after this time, unless the guest has ended.
cut() {
    sleep "$(printf '%d.%03d' $(($1 / 1000)) $(($1 % 1000)))"
    touch "$root/cut" && kill -KILL "$(cat "$root/pid")"
}
# Prints the guest's output, and passes lines for QEMU on to its monitor.
follow() {
    local line
    exec 3<>"$root/monitor.in"
    while IFS= read -r line; do
        case ${line%$'\r'} in
        GUEST-UNPLUG:*) line=${line%$'\r'} && echo "device_del ${line#*:}" >&3 ;;
        GUEST-PLUG:*) line=${line%$'\r'} && echo "device_add ${plugged[${line#*:}]},id=${line#*:}" >&3 ;;
        GUEST-CUT:*) line=${line%$'\r'} && cut "${line#*:}" 2>/dev/null & ;;
        GUEST-EXIT:* | *"reboot: Power down") ;;
        *) printf '%s\n' "$line" ;;
        esac
    done
}
# The guest keeps real time, so it has priority over other work if this is permitted.
first=()
nice -n -10 true 2>&1 | grep -q . || first=(nice -n -10)
# One processor and no acceleration make the same machine everywhere. `timeout` ends one that hangs.
began=$(date +%s)
# A killed emulator is not worth a message of the shell.
{ (cd "$root" && exec "${first[@]}" timeout --kill-after=5 "${SONOWEAVE_GUEST_SECONDS:-240}" "$qemu" "${data[@]}" \
    -M pc -accel tcg -cpu max -smp 1 -m 512 -nodefaults -no-user-config -display none -no-reboot -serial stdio \
    -kernel "$place/vmlinux" -initrd "$root.cpio" \
    -append "console=ttyS0 quiet loglevel=3 panic=-1 mitigations=off -- $*" \
    -pidfile pid -chardev pipe,id=monitor,path=monitor -mon chardev=monitor,mode=readline "${machine[@]}" </dev/null 2>&1) |
    tee "$log" | follow || true; } 2>/dev/null
if [ -e "$root/cut" ]; then
    rm -f "$log"
    exit 0
fi
code=$(tr -d '\r' <"$log" | sed -n 's/^GUEST-EXIT:\([0-9]*\)$/\1/p' | tail -n 1)
[ -n "$code" ] || fail "the guest did not say how its program ended: it hung, or its kernel stopped; its console is in $log"
rm -f "$log"
echo "guest: $(basename "$program") ended with $code after $(($(date +%s) - began)) s"
exit "$code"
