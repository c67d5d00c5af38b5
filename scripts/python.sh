#!/usr/bin/env bash
# Builds the Python package and runs its checks: the wheel from a source distribution, its tests
# with the oldest and the newest NumPy, a cluster by Slurm, types, documentation and tutorials.
# Installs Debian's python3-venv and Slurm if they are missing, and Python packages into out/python
# (700 MB).
#
#   scripts/python.sh [wheel|folder|test]
#
# With wheel it only builds, with test it only checks the wheel that was built. With folder it
# builds the wheel from the folder itself, with the crates of the optimised programs, and lets the
# compiler check the source distribution.
#
# SONOWEAVE_PYTHON_QUICK=1 builds the module without optimisation and from the folder itself.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
out=$root/out/python
say() { echo "python: $*"; }
part=${1:-}
case $part in
"" | wheel | folder | test) ;;
*)
    echo "python: there is no part \"$part\"; give wheel, folder or test" >&2
    exit 2
    ;;
esac

scripts/setup.sh python
# environment NAME REQUIREMENT…: makes an environment, once.
environment() {
    local name=$1 wanted
    shift
    wanted=$(cat python/requirements.txt; printf '%s\n' "$@")
    if [ ! -x "$out/$name/bin/python" ] || [ "$wanted" != "$(cat "$out/$name/wanted.txt" 2>/dev/null)" ]; then
        say "installing Python packages into $out/$name"
        python3 -m venv --clear "$out/$name"
        "$out/$name/bin/pip" --disable-pip-version-check install --quiet --no-compile -r python/requirements.txt "$@"
        printf '%s' "$wanted" >"$out/$name/wanted.txt"
    fi
}
mkdir -p "$out"
environment newest "numpy>=2"
maturin=$out/newest/bin/maturin

program=${SONOWEAVE_PROGRAM:-}
# Builds the wheel into out/python/wheels.
build_wheel() {
    rm -rf "$out/dist" "$out/wheels" "$out/source"
    mkdir -p "$out/dist" "$out/wheels" "$out/source"
    local build=(--locked --interpreter "$out/newest/bin/python" --out "$out/wheels")
    if [ -n "${SONOWEAVE_PYTHON_QUICK:-}" ]; then
        (cd python && "$maturin" build --profile dev "${build[@]}" --quiet)
        return
    fi
    cargo fetch --locked --quiet
    (cd python && "$maturin" sdist --out "$out/dist" >"$out/sdist.log" 2>&1)
    # The distribution's files have one time for ever: with it, cargo would take changed sources for
    # those of the last build.
    tar xzmf "$out"/dist/sonoweave-*.tar.gz -C "$out/source" --strip-components=1
    # The distribution lacks some members of the workspace: what only they need leaves the list of
    # crates, and nothing enters it.
    pairs() { awk -F'"' '/^name = /{ name = $2 } /^version = /{ print name, $2 }' "$1" | sort; }
    pairs "$out/source/Cargo.lock" >"$out/crates.txt"
    (cd "$out/source" && cargo metadata --offline --format-version 1 >/dev/null)
    local new
    new=$(pairs "$out/source/Cargo.lock" | comm -23 - "$out/crates.txt")
    [ -z "$new" ] || {
        say "the distribution would be built with other crates: $new" >&2
        exit 1
    }
    if [ "$part" = folder ]; then
        share debug
        (cd "$out/source" && CARGO_TARGET_DIR=$root/target/wheel cargo check --locked --quiet -p sonoweave-python)
        say "building the wheel"
        (cd python && "$maturin" build --release "${build[@]}" --quiet)
        return
    fi
    share release
    say "building the wheel from the source distribution"
    (cd "$out/source" && CARGO_TARGET_DIR=$root/target/wheel CARGO_PROFILE_RELEASE_DEBUG=0 CARGO_INCREMENTAL=0 \
        "$maturin" build --release "${build[@]}" --quiet)
}
# share KIND: gives builds of the source distribution other projects' crates that are built already.
# The lock is not shared, so that other builds do not wait for these.
share() {
    [ -d "target/$1/deps" ] && [ ! -d "target/wheel/$1" ] || return 0
    mkdir -p "target/wheel/$1"
    cp -al "target/$1/deps" "target/$1/build" "target/wheel/$1/"
    cp -a "target/$1/.fingerprint" "target/wheel/$1/"
}
[ "$part" = test ] || build_wheel
wheel=$(echo "$out"/wheels/sonoweave-*.whl)
bytes=$(stat -c %s "$wheel")
say "$(basename "$wheel"), $((bytes / 1000)) kB"
[ "$bytes" -le 25000000 ] || {
    say "the wheel exceeds 25 MB" >&2
    exit 1
}
case $part in wheel | folder) exit 0 ;; esac
if [ -z "$program" ] && [ -n "${SONOWEAVE_PYTHON_QUICK:-}" ]; then
    cargo build --locked --quiet -p sonoweave
    program=${CARGO_TARGET_DIR:-target}/debug/sonoweave
fi
program=${program:-$(scripts/build.sh)}
export SONOWEAVE_PROGRAM
SONOWEAVE_PROGRAM=$(realpath "$program")

# Outside of the sources, so that the installed package is tested.
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
install() { "$out/$1/bin/pip" --disable-pip-version-check install --quiet --force-reinstall --no-deps "$wheel"; }
tests() { (cd "$work" && "$out/$1/bin/python" -m pytest -q -p no:cacheprovider -c "$root/python/pyproject.toml" --rootdir "$root/python" "${@:2}"); }

install newest
say "tests with NumPy $("$out/newest/bin/python" -c 'import numpy; print(numpy.__version__)')"
tests newest "$root/python/tests"
scripts/interop/slurm.sh "$out/newest/bin/python" "$SONOWEAVE_PROGRAM"
say "documentation"
tests newest --doctest-modules --pyargs sonoweave
"$out/newest/bin/python" scripts/python_documentation.py
say "types"
cp python/pyproject.toml "$work/"
(cd "$work" && "$out/newest/bin/mypy" --strict -p sonoweave && "$out/newest/bin/mypy" --strict "$root"/python/tutorials/*.py &&
    "$out/newest/bin/python" -m mypy.stubtest sonoweave --mypy-config-file pyproject.toml)

# NumPy of Debian 12; other packages need a newer one.
if [ ! -x "$out/oldest/bin/python" ]; then
    python3 -m venv --clear "$out/oldest"
    "$out/oldest/bin/pip" --disable-pip-version-check install --quiet --no-compile "numpy==1.24.*" "pytest<9"
fi
install oldest
say "tests with NumPy $("$out/oldest/bin/python" -c 'import numpy; print(numpy.__version__)')"
tests oldest "$root/python/tests" --ignore "$root/python/tests/test_tutorials.py"
say "passed"
