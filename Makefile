# Each target first installs what the machine lacks (scripts/setup.sh says what and asks sudo when not root).
.PHONY: all demo test hardware-test interop console-test bench fuzz peers stress reach console-cost console-reach paper pareto check setup deb deb-test fresh-machine

all: test

setup:
	@scripts/setup.sh

# A synthetic sweep, reconstructed; says where the volume and a picture of it are.
demo: setup
	scripts/demo.sh

# The pictures' own tests come with the pictures: what draws them takes as long to build as everything else here.
test: setup
	cargo test --workspace --exclude sonoweave-figures --locked

check: setup
	.ci/run

bench: setup
	cargo bench --locked --bench reconstruct
	cargo bench --locked --bench render
	cargo bench --locked -p sonoweave-calibration --bench dots
	cargo bench --locked -p sonoweave-drivers --bench decoders
	cargo bench --locked -p sonoweave-drivers --bench pixels
	cargo bench --locked -p sonoweave-drivers --bench latency
	cargo bench --locked -p sonoweave-drivers --bench session
	cargo bench --locked -p sonoweave-drivers --bench images

# Searches for bytes that break a decoder of the devices' wire formats or a reader of files and configurations, FUZZ_SECONDS for each; says so where it cannot.
FUZZ_SECONDS ?= 60
fuzz: setup
	FUZZ_SECONDS=$(FUZZ_SECONDS) scripts/fuzz.sh

# Drivers against the kernel's own, in a small emulated machine with virtual devices: scripts/guest/README.md. FILTER=word for the tests of that name.
hardware-test: setup
	scripts/hardware-test.sh $(FILTER)

# What the bench of the renderer then also times: VTK, in an environment of its own in out/peers (600 MB, from the package index that pip is set up for).
peers:
	scripts/peers/environment.sh

# Image files both ways with SimpleITK, VTK, pynrrd and nibabel: the same voxels at the same place. They go into an environment of their own in out/interop (800 MB, from
# the package index that pip is set up for). And our DICOM: dciodvfy finds no error in it, pydicom the same voxels in the same places, and an Orthanc server on loopback
# returns what it is given. And OpenIGTLink with the reference library and pyigtl, as clients and as servers.
interop:
	@scripts/setup.sh interop
	scripts/interop/environment.sh
	cargo build --locked --bin sonoweave
	scripts/interop/run.sh
	scripts/interop/dicom.sh
	scripts/interop/igtl.sh

# The console's page in Debian's Chromium, which looks at a session at the virtual bedside, steers it, and loses and finds it again; pictures of it are in out/console-test.
console-test:
	@scripts/setup.sh console
	scripts/console-test.sh

# Numerical stability: 10⁶ slices and days of stamps (STRESS=quick: seconds), a session that goes on and on, and errors put into the source, which tests must notice.
STRESS ?= full
stress: setup
	SONOWEAVE_STRESS=$(STRESS) cargo test --locked --test stress
	SONOWEAVE_STRESS=$(STRESS) cargo test --locked --test soak -- --nocapture
	SONOWEAVE_STRESS=$(STRESS) cargo test --locked -p sonoweave-drivers --test steady
	cargo test --locked --test mutants -- --include-ignored

# What a session at the virtual bedside attains: losses, latencies, replay, start; SECONDS_30 and SECONDS_60 of video at 30 and 60 a second. Nothing else should run meanwhile.
SECONDS_30 ?= 600
SECONDS_60 ?= 120
reach: setup
	SECONDS_30=$(SECONDS_30) SECONDS_60=$(SECONDS_60) scripts/reach.sh

# What those who look at a session cost it, hidden pages and clients that are no good: losses and times of the same session with and without, SECONDS_EACH. Nothing else should run meanwhile.
SECONDS_EACH ?= 60
console-cost: setup
	SECONDS_EACH=$(SECONDS_EACH) scripts/console-cost.sh

# In Debian's Chromium: how long pictures take to its screen, what pages cost that look at a session that stands still, and that nobody's pictures are drawn. Nothing else should run meanwhile.
console-reach:
	@scripts/setup.sh console
	SECONDS_EACH=$(SECONDS_EACH) scripts/console-test.sh reach

# The 1992 paper's figures and claims with ours beside them: out/paper/index.html. `make paper QUICK=--quick` for a smoke test.
paper: setup
	cargo test --release --locked -p sonoweave-figures
	cargo run --release --locked -p sonoweave-figures --bin paper -- $(QUICK)

# Run time against error, over phantoms and recordings: out/pareto/index.html. `make pareto QUICK=--quick` for a smoke test.
pareto: setup
	cargo run --release --locked -p sonoweave-figures --bin pareto -- $(QUICK)

# A Debian package in out/deb: the program, its service, udev rules, manual pages, completions and examples.
deb:
	@scripts/setup.sh package
	scripts/deb.sh

# Proves, as root and on a bare Debian 12 in a folder and a container, that the package installs, works, serves and goes again.
deb-test:
	@scripts/setup.sh package
	scripts/deb-test.sh

# Proves, as root and on a bare Debian 12 in a folder, that demo and test need no more than git, make, curl and Rust.
fresh-machine:
	scripts/fresh-machine.sh
