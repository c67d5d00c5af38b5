# Each target first installs what the machine lacks. scripts/setup.sh names it, and uses sudo when
# it does not run as root.
.PHONY: all setup quick style test demo check mutants stress soak bench fuzz peers hardware-test interop \
	console-test pictures reach arm-session console-cost console-reach paper pareto accuracy numbers deb deb-test release \
	release-test arm64 deny book fresh-machine sync-cost render-parts python python-bench scale zarr-write

# All targets that test select the same packages. Other selections give dependencies other features,
# and most crates would be built again. The figures are left out: the crates that draw them take as
# long to build as everything else. So is the Python module, whose tests are Python's (make python).
PACKAGES = --workspace --exclude sonoweave-figures --exclude sonoweave-python --locked
# The tests of checks/.
STYLE = --test dependencies --test figures --test fleet --test style --test workflows

all: test

setup:
	@scripts/setup.sh

# Checks the format and the style, and lints and unit-tests the crates that changed and those that
# depend on them. BASE=commit compares with that commit; the default is the last one.
quick: setup
	scripts/quick.sh $(BASE)

# Checks comments, names and lengths of files, and that modules and crates have no cycles.
style: setup
	cargo test $(PACKAGES) $(STYLE)

# Runs the tests that need neither hardware nor other programs, several programs at a time, but for
# those of the figures, the errors in the source, and the command line's five longest.
test: setup
	scripts/test.sh $(PACKAGES)

# Runs a session without hardware, in the browser where there is a display, until Ctrl-C. With
# DURATION=seconds it ends by itself, and the session is replayed and compared as well.
DURATION ?=
demo: setup
	scripts/demo.sh $(DURATION)

# Runs everything that a change must pass, the quick checks first.
check: setup
	.ci/run

# Inserts errors into the source, which tests must notice. MUTANTS=share tries those of changed
# files and a rotating twentieth. FILTER=word tries those with that word in their names.
MUTANTS ?= all
mutants: setup
	SONOWEAVE_MUTANTS=$(MUTANTS) cargo test $(PACKAGES) --test mutants -- --include-ignored $(if $(FILTER),"$(FILTER)")

# Builds the Python package from a source distribution, and runs its tests with the oldest and the
# newest NumPy, its documentation, types and tutorials.
python: setup
	@scripts/setup.sh python
	scripts/python.sh

# Times the Python package beside the command, with the wheel of `make python`, on a calm machine.
python-bench: setup
	@test -x out/python/newest/bin/python || { echo "make python-bench: run make python before" >&2; exit 1; }
	out/python/newest/bin/python python/bench.py "$$(scripts/build.sh)"

# Tests numerical stability with 10⁶ slices and days of stamps, the clocks with 10⁶ random cases, a
# session that runs for long, and what takes long on the command line. STRESS=quick takes minutes.
STRESS ?= full
# Cases of each of the five properties of clocks.
CASES ?= $(if $(filter quick,$(STRESS)),2000,200000)
stress: setup
	SONOWEAVE_STRESS=$(STRESS) cargo test $(PACKAGES) --test stress
	PROPTEST_CASES=$(CASES) cargo test -p sonoweave -p sonoweave-sync --locked --lib clock::tests
	SONOWEAVE_STRESS=$(STRESS) cargo test -p sonoweave-calibration --locked --lib -- --include-ignored
	SONOWEAVE_STRESS=$(STRESS) cargo test $(PACKAGES) --test borders
	SONOWEAVE_STRESS=$(STRESS) cargo test $(PACKAGES) --test soak -- --nocapture
	SONOWEAVE_STRESS=$(STRESS) cargo test $(PACKAGES) --test steady
	cargo test $(PACKAGES) --test cli -- --ignored

# Runs a whole session for HOURS: 60 frames a second, recorded, viewed on a page that turns the view,
# with faults each minute. Its memory must stay constant, its losses be named, and its recording
# replay to the same bits. Two hours need 10 GB of disk. Nothing else should run meanwhile.
HOURS ?= 2
soak: setup
	SONOWEAVE_SOAK_HOURS=$(HOURS) cargo test --release $(PACKAGES) --test soak -- --nocapture

# Enters a run's figures into a record of docs/numbers, which the documents show. A quick run's, and
# those of sources that are not committed, go to out/numbers alone. Folders are what is measured.
NUMBERS = "$$(scripts/build.sh numbers)"
INSERTION = crates/core,crates/simd,crates/mask,crates/volume,crates/reconstruct,benches/reconstruct
RENDERING = $(INSERTION),crates/render,benches/render
RECORDING = crates/core,crates/formats,drivers/benches/session.rs
SESSION = src,crates,drivers,calibration

# Measures run times. Every timed run checks its answer. QUICK=--quick is a smoke test.
QUICK_FOLDER = $(if $(QUICK),quick,.)
bench: setup
	cargo bench --locked --bench reconstruct -- $(QUICK)
	$(NUMBERS) record reconstruct out/bench/$(QUICK_FOLDER)/figures.json --command "make bench" --sources $(INSERTION)
	$(NUMBERS) record igsio out/bench/$(QUICK_FOLDER)/figures.json --command "make bench" --sources $(INSERTION)
	cargo bench --locked --bench render -- $(QUICK)
	$(NUMBERS) record render out/bench/$(if $(QUICK),quick-)render/figures.json --command "make bench" --sources $(RENDERING)
	$(NUMBERS) record vtk out/bench/$(if $(QUICK),quick-)render/figures.json --command "make bench" --sources $(RENDERING)
	$(NUMBERS) record render-parts out/bench/$(if $(QUICK),quick-)render/figures.json --command "make bench" \
		--sources $(RENDERING)
	cargo bench --locked -p sonoweave-calibration --bench dots
	cargo bench --locked -p sonoweave-drivers --bench decoders
	cargo bench --locked -p sonoweave-drivers --bench pixels
	cargo bench --locked -p sonoweave-drivers --bench latency
	cargo bench --locked -p sonoweave-drivers --bench session -- $(QUICK)
	$(NUMBERS) record sync-cost out/bench/$(if $(QUICK),quick-)session/figures.json --command "make bench" \
		--sources $(RECORDING)
	cargo bench --locked -p sonoweave-drivers --bench images
	$(MAKE) --no-print-directory zarr-write

# Measures the time that syncs take from the writer of a recording. Nothing else should run
# meanwhile.
sync-cost: setup
	cargo bench --locked -p sonoweave-drivers --bench session -- --syncs $(QUICK)
	$(NUMBERS) record sync-cost out/bench/$(if $(QUICK),quick-)session/figures.json --command "make sync-cost" \
		--sources $(RECORDING)

# Measures pictures that are rendered in parts of the volume beside pictures without parts: the rule
# by which a picture is cut. Nothing else should run meanwhile.
render-parts: setup
	cargo bench --locked --bench render -- --parts $(QUICK)
	$(NUMBERS) record render-parts out/bench/$(if $(QUICK),quick-)render-parts/figures.json \
		--command "make render-parts" --sources $(RENDERING)

# The long forms of what `make test`, `make interop` and `make python` check in short ones: faults of
# batches, regions and stores; volumes larger than memory; clusters. Then it measures the memory and
# the speed of writing OME-Zarr. Takes half an hour; installs what `make interop` and `make python` do.
ZARR = crates/formats,crates/ome_zarr
scale: setup
	SONOWEAVE_STRESS=full cargo test --release $(PACKAGES) --test cli -- --include-ignored batch region ome_zarr
	@scripts/setup.sh interop
	scripts/interop/environment.sh interop
	scripts/interop/ome_zarr.sh
	scripts/interop/failing_store.sh
	scripts/python.sh
	$(MAKE) --no-print-directory zarr-write

# Measures the memory and the speed of writing OME-Zarr. Nothing else should run meanwhile.
zarr-write: setup
	cargo bench --locked -p sonoweave-ome-zarr --bench write -- $(QUICK)
	$(NUMBERS) record ome-zarr out/bench/$(if $(QUICK),quick-)ome-zarr/figures.json --command "make zarr-write" \
		--sources $(ZARR)

# Makes the book of the pages in docs: out/book. The checks of `make style` hold its links, commands
# and messages.
book: setup
	scripts/book.sh

# Searches for bytes that break a decoder of the devices' wire formats or a reader of files and
# configurations, FUZZ_SECONDS for each. It fails where it cannot, unless FUZZ_OPTIONAL=1.
FUZZ_SECONDS ?= 60
fuzz: setup
	FUZZ_SECONDS=$(FUZZ_SECONDS) scripts/fuzz.sh

# Tests drivers against the kernel's own, in a small emulated machine with virtual devices.
# scripts/guest/README.md describes it. FILTER=word runs the tests with that word in their names.
hardware-test: setup
	scripts/hardware-test.sh $(FILTER)

# Installs VTK into out/peers (600 MB, from the package index that pip is set up for). The
# renderer's bench then times it as well. IGSIO=FOLDER also compiles IGSIO's insertion from a
# checkout in that folder into out/igsio, with Debian's VTK (900 MB); the reconstruction's bench
# then times it as well.
peers:
	scripts/peers/environment.sh
	$(if $(IGSIO),scripts/peers/igsio.sh "$(IGSIO)")

# Exchanges files and messages with other programs in both directions, which go into out/interop
# (800 MB, from the package index that pip is set up for). Images: SimpleITK, VTK, pynrrd and
# nibabel find the same voxels at the same place. DICOM: dciodvfy finds no error, pydicom the same
# voxels at the same place, and an Orthanc server on loopback returns what it received. OpenIGTLink:
# the reference library and pyigtl, as clients and as servers. Sessions: an independent reader of
# MCAP and Foxglove's own classes find the same pictures and poses. Batches: Snakemake runs the
# example of the documents. A fleet: Debian's Prometheus scrapes ten sessions by packaging/fleet.
interop:
	@scripts/setup.sh interop
	scripts/interop/environment.sh interop
	scripts/interop/run.sh
	scripts/interop/dicom.sh
	scripts/interop/igtl.sh
	scripts/interop/session.sh
	scripts/interop/ome_zarr.sh
	scripts/interop/failing_store.sh
	scripts/interop/environment.sh snakemake
	scripts/interop/batch.sh
	scripts/interop/fleet.sh

# Tests the console's page in Debian's Chromium: it shows a session at the virtual bedside, steers
# it, and loses and finds it again. Pictures of the page are in out/console-test.
console-test:
	@scripts/setup.sh console
	scripts/console-test.sh

# Makes the documents' pictures of the console, the demo and a calibration's report, in Debian's
# Chromium. Nothing else should run meanwhile.
pictures:
	@scripts/setup.sh console
	scripts/console-test.sh pictures

# Measures a session at the virtual bedside: losses, latencies, replay and start. It takes
# SECONDS_30 of video at 30 frames a second and SECONDS_60 at 60. Nothing else should run meanwhile.
SECONDS_30 ?= 600
SECONDS_60 ?= 120
reach: setup
	SECONDS_30=$(SECONDS_30) SECONDS_60=$(SECONDS_60) scripts/reach.sh
	$(NUMBERS) record reach out/reach/figures.json --command "make reach" --sources $(SESSION)

# Measures insertion in live sessions of a virtual arm by both paths. Nothing else should
# run meanwhile.
arm-session: setup
	scripts/arm-session.sh
	$(NUMBERS) record arm-session out/arm-session/figures.json --command "make arm-session" --sources $(SESSION)

# Measures the cost of the console to a session: losses and times of the same session with and
# without pages, hidden pages and bad clients, SECONDS_EACH, the last in ROUNDS alternating rounds.
# Nothing else should run meanwhile.
SECONDS_EACH ?= 60
ROUNDS ?= 5
console-cost: setup
	SECONDS_EACH=$(SECONDS_EACH) ROUNDS=$(ROUNDS) scripts/console-cost.sh
	$(NUMBERS) record console-cost out/console-cost/figures.json \
		--command "make console-cost SECONDS_EACH=$(SECONDS_EACH)" --sources $(SESSION)

# Measures in Debian's Chromium the delay of pictures to its screen, and the cost of pages that view
# a static session. It checks that pictures of closed pages are not rendered. Nothing else should
# run meanwhile.
console-reach:
	@scripts/setup.sh console
	SECONDS_EACH=$(SECONDS_EACH) scripts/console-test.sh reach
	$(NUMBERS) record console-reach out/console-test/figures.json \
		--command "make console-reach SECONDS_EACH=$(SECONDS_EACH)" --sources $(SESSION)

# Figures are made by an optimised build. QUICK=--quick is a smoke test. The packages that are
# selected for their tests must be those of SONOWEAVE_RELEASE, where that is set.
FIGURES = $(if $(SONOWEAVE_RELEASE),--workspace,-p sonoweave-figures)

# Draws the 1992 paper's figures and claims with ours beside them: out/paper/index.html.
paper: setup
	cargo test --release --locked $(FIGURES) --bin paper --bin pareto --test plots
	"$$(scripts/build.sh paper)" $(QUICK)

# Draws run time against error, over phantoms and recordings: out/pareto/index.html.
pareto: setup
	"$$(scripts/build.sh pareto)" $(QUICK)
	$(NUMBERS) record pareto out/pareto/$(QUICK_FOLDER)/figures.json --command "make pareto" \
		--sources $(RENDERING),crates/phantom,figures/src/bin/pareto

# Measures errors with corrections of poses on and off: out/accuracy/index.html.
accuracy: setup
	"$$(scripts/build.sh accuracy)" $(QUICK)
	$(NUMBERS) record accuracy out/accuracy/$(QUICK_FOLDER)/figures.json --command "make accuracy" \
		--sources crates/core,crates/sync,crates/volume,crates/reconstruct,crates/phantom,calibration,figures/src/bin/accuracy

# Writes the measured figures of the documents from their records in docs/numbers. Where measured
# sources have changed since, the text states the commit of the measurement.
numbers: setup
	$(NUMBERS)

# Makes a Debian package in out/deb: the program, its service, udev rules, manual pages, completions
# and examples.
deb:
	@scripts/setup.sh package
	scripts/deb.sh

# Tests, as root and on a bare Debian 12 in a folder and a container, that the package installs,
# works, serves and is removed.
deb-test:
	@scripts/setup.sh package
	scripts/deb-test.sh

# Makes a release of the last commit in out/release: the package, a static program in a tarball,
# both for arm64 too, the Python wheel, lists of crates, the version's changes and SHA256SUMS.
release:
	@scripts/setup.sh release
	@scripts/setup.sh python
	scripts/release.sh

# Tests, as root, that a release has the same bytes from another folder, and that its program runs
# on a bare Debian 12, on another Debian and in an empty folder. It takes two builds.
release-test:
	@scripts/setup.sh release
	@scripts/setup.sh python
	scripts/release-test.sh

# Builds the program for arm64, and tests in an emulated processor that it has the same bits as on
# x86-64. The emulator's speed says nothing about a processor's.
arm64: setup
	@scripts/setup.sh arm64
	scripts/arm64.sh

# Compares the crates with deny.toml, and with the advisories of RustSec, by cargo-deny. It fails
# where the advisories cannot be fetched, unless DENY_OPTIONAL=1. `make style` checks the rest.
deny: setup
	scripts/deny.sh

# Tests, as root and on a bare Debian 12 in a folder, that demo and test need only git, make, curl
# and Rust.
fresh-machine:
	scripts/fresh-machine.sh
