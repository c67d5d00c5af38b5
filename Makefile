# Each target first installs what the machine lacks (scripts/setup.sh says what and asks sudo when not root).
.PHONY: all demo test bench stress check setup fresh-machine

all: test

setup:
	@scripts/setup.sh

# A synthetic sweep, reconstructed; says where the volume and a picture of it are.
demo: setup
	scripts/demo.sh

test: setup
	cargo test --workspace --locked

check: setup
	.ci/run

bench: setup
	cargo bench --locked --bench reconstruct

# Numerical stability: 10⁶ slices and days of stamps (STRESS=quick: seconds), and errors put into the source, which tests must notice.
STRESS ?= full
stress: setup
	SONOWEAVE_STRESS=$(STRESS) cargo test --locked --test stress
	cargo test --locked --test mutants -- --include-ignored

# Proves, as root and on a bare Debian 12 in a folder, that demo and test need no more than git, make, curl and Rust.
fresh-machine:
	scripts/fresh-machine.sh
