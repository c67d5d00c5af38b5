# Each target first installs what the machine lacks (scripts/setup.sh says what and asks sudo when not root).
.PHONY: all demo test bench check setup fresh-machine

all: test

setup:
	@scripts/setup.sh

test: setup
	cargo test --workspace --locked

check: setup
	.ci/run

bench: setup
	cargo bench --locked --bench reconstruct
