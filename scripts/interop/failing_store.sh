#!/bin/sh
# Reconstructs a volume in regions on a file system that fails at every seventh call of a kind:
# open, write or fsync; for the second try at every fourteenth, and so on. Each process that meets a
# failure ends with exit code 7, and nothing half done counts. Repeated, the processes make the
# volume of an undisturbed one, byte by byte.
set -eu
cd "$(dirname "$0")/../.."

program=$(scripts/build.sh)
source=$PWD/scripts/interop/failing_store.c
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
cc -shared -fPIC -O1 -Wall -Werror -o failing_store.so "$source" -ldl

fail() {
    echo "failing_store: $1" >&2
    exit 1
}
settings="--spacing 0.15 --sigma 0.3,0.3,0.3 --clip none --path general --type f32"
"$program" phantom -o s.mha --frames 40 --image-size 48x40 --pixel 0.5 --gap 0.5 --trajectory freehand -q >/dev/null
# shellcheck disable=SC2086 # options are words
"$program" reconstruct s.mha $settings -o whole.ome.zarr >/dev/null

for call in open write fsync; do
    mkdir "$call"
    # shellcheck disable=SC2086 # options are words
    "$program" regions plan s.mha $settings --max-memory 0.024 -o "$call/v.ome.zarr" >/dev/null
    failures=0
    # Tries a command until it succeeds.
    until_done() {
        tries=0
        while :; do
            code=0
            LD_PRELOAD=./failing_store.so FAILING_FOLDER=$folder/$call FAILING_CALL=$call FAILING_EVERY=$((7 * (tries + 1))) \
                "$program" "$@" >out.txt 2>err.txt || code=$?
            [ "$code" -ne 0 ] || return 0
            [ "$code" -eq 7 ] || fail "$call: \`$*\` ended with code $code: $(cat err.txt)"
            [ ! -e "$call/v.ome.zarr" ] || [ "$2" = finish ] || fail "$call: there is a volume before its end"
            failures=$((failures + 1)) tries=$((tries + 1))
            [ "$tries" -lt 100 ] || fail "$call: \`$*\` does not go on"
        done
    }
    until_done regions run "$call/v.ome.zarr" --threads 2
    until_done regions finish "$call/v.ome.zarr"
    [ "$failures" -gt 0 ] || fail "$call: no call has failed"
    diff -r whole.ome.zarr "$call/v.ome.zarr" >/dev/null || fail "$call: the volume has other files"
    [ ! -e "$call/v.ome.zarr.part" ] || fail "$call: an unfinished volume is left"
    echo "failing_store: $call: $failures processes have failed; the volume is that of an undisturbed one"
done
