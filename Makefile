# `make demo` needs a Rust toolchain and a C compiler; `make test` fetches the rest itself.

PYTHON := .venv/bin/python
TDCR := $(CURDIR)/target/release/tdcr

.PHONY: demo build test setup format lint docs test-rust test-python bench clean

demo: build
	$(TDCR) demo --out demo_out

build:
	cargo build --release --locked

# Everything that must hold at every commit.
test: setup format lint docs test-rust test-python

setup:
	@scripts/setup.sh

format:
	cargo fmt --all --check

lint:
	cargo clippy --workspace --all-targets --release --locked -- -D warnings

docs:
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked

# In release mode: the tests settle tens of thousands of robots and train small networks.
test-rust:
	cargo test --workspace --release --locked

test-python: build
	TDCR=$(TDCR) $(PYTHON) -m pytest -q tests/python

bench:
	cargo bench --workspace --locked

clean:
	cargo clean
	rm -rf .venv demo_out
