#!/bin/sh
# Builds all tests, and runs their programs side by side: one for each core, and one of those that
# mostly wait for devices and clients. Prints the time of each program and that of the processors,
# and what a failed one has printed.
#
#   scripts/test.sh CARGO-OPTIONS…
#
# The options select the packages. Every test program of theirs is run, and all documentation tests.
# With --lib or --bins only unit tests are. With SONOWEAVE_STRESS=quick, as in CI, random draws
# are more, and the command line's long tests are run, which are ignored otherwise.
set -eu
cd "$(dirname "$0")/.."
began=$(date +%s)

cargo test "$@" --no-run
logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT
export logs

# Lines of package, its folder, and program. Nothing is built again.
cargo test "$@" --no-run --message-format=json 2>/dev/null | sed -n \
    's/.*"package_id":"[^"]*#\([a-z0-9-]*\)@[^"]*","manifest_path":"\([^"]*\)\/Cargo.toml".*"profile":{[^}]*"test":true}.*"executable":"\([^"]*\)".*/\1 \2 \3/p' \
    >"$logs/programs"
[ -s "$logs/programs" ] || {
    echo "test: cargo named no test program" >&2
    exit 1
}
count=$(wc -l <"$logs/programs")

# Runs one, in the environment in which cargo runs tests.
cat >"$logs/run" <<'EOF'
#!/bin/sh
package=$1 folder=$2 program=$3
name="$package/$(basename "$program" | sed 's/-[0-9a-f]*$//')"
began=$(date +%s)
cd "$folder" || exit 1
if [ "$program" = doc ]; then
    # shellcheck disable=SC2086 # options are words
    cargo test $4 --doc >"$logs/$package-doc.log" 2>&1
else
    set --
    case $program in
    # The command line's tests wait half of the time.
    */cli-*)
        export RUST_TEST_THREADS=4
        [ -z "${SONOWEAVE_STRESS:-}" ] || set -- --include-ignored
        ;;
    # A session for minutes needs a machine with nothing else to do.
    */soak-*) unset SONOWEAVE_STRESS ;;
    esac
    CARGO=$(command -v cargo) CARGO_MANIFEST_DIR=$folder CARGO_PKG_NAME=$package "$program" "$@" \
        >"$logs/$(basename "$program").log" 2>&1
fi
code=$?
seconds=$(($(date +%s) - began))
# User and system time of the programs that have ended: "2m3.45s 0m6.78s".
times >"$logs/$$.times"
busy=$(($(sed -n 's/\.[0-9]*s//g; 2s/\([0-9]*\)m\([0-9]*\) \([0-9]*\)m\([0-9]*\)/\1 * 60 + \2 + \3 * 60 + \4/p' "$logs/$$.times")))
if [ $code -eq 0 ]; then
    # Tests that are left out are named; of many, such as the mutants, the number is told.
    sed -n 's/^test \(.*[^ ]\) *\.\.\. ignored.*/\1/p' "$logs"/*"$(basename "$program")".log >"$logs/$$.ignored"
    many=$(grep -c '' "$logs/$$.ignored" || true)
    if [ "$many" -gt 20 ]; then echo "$many of $name" >"$logs/$$.names"; else cp "$logs/$$.ignored" "$logs/$$.names"; fi
    printf '%6d s %6d s  passed  %s%s\n' $seconds $busy "$name" "$(sed 's/^/\n                           ignored: /' "$logs/$$.names" | sed '/^$/d' | sed '1s/^/\n/')"
else
    # One write, so that the logs of two programs do not mix.
    printf '%s\n%6d s %6d s  FAILED  %s\n' "$(cat "$logs"/*"$(basename "$program")".log)" $seconds $busy "$name"
    exit 1
fi
EOF
chmod +x "$logs/run"
docs=yes
side_by_side=1
# With unit tests alone, two programs that wait are run side by side. Those of the console and of
# OpenIGTLink would otherwise be the last to end.
case " $* " in *" --lib "* | *" --bins "*) docs= side_by_side=2 ;; esac
# Their tests mostly wait, many at a time.
waiting='/(live|console|igtl|listener|steady|damage|fuzz_corpus|session)-[0-9a-f]*$'
grep -E "$waiting" "$logs/programs" >"$logs/waiting" || true
{
    # The longest first, so that nothing waits for it at the end.
    for name in cli calibration stress recordings; do grep -E "/$name-[0-9a-f]*$" "$logs/programs" || true; done
    [ -z "$docs" ] || echo "documentation $PWD doc $(printf '"%s"' "$*")"
    grep -Ev "$waiting|/(cli|recordings|stress|calibration)-[0-9a-f]*$" "$logs/programs" || true
} >"$logs/order"
RUST_TEST_THREADS=8 xargs -r -P "$side_by_side" -L 1 "$logs/run" <"$logs/waiting" &
waited=$!
code=0
xargs -r -P "$(nproc)" -L 1 "$logs/run" <"$logs/order" || code=$?
wait "$waited" || code=$?
[ $code -eq 0 ] || {
    echo "test: failed after $(($(date +%s) - began)) s; run one with: cargo test -p sonoweave -p PACKAGE --test NAME, or --lib" >&2
    exit 1
}
skipped=$(cat "$logs"/*.ignored | grep -c '' || true)
names=$(sort -u "$logs"/*.names | paste -sd, | sed 's/,/, /g')
echo "test: $count programs${docs:+ and the documentation} passed in $(($(date +%s) - began)) s; $skipped tests were skipped${names:+: $names}"
