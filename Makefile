# `make demo` needs a Rust toolchain and a C compiler; `make test` fetches the rest itself.

PYTHON := .venv/bin/python
TDCR := $(CURDIR)/target/release/tdcr

# All but the crate that calls MuJoCo's C library: `make test-mujoco` alone needs MuJoCo and libclang.
WORKSPACE := --workspace --exclude tdcr-mujoco
# Cargo gives the dependencies the features that all chosen targets need. Where examples are among them, these are the
# features that tests need too, so tests, documentation and the binary share one build of the dependencies.
WITH_EXAMPLES := $(WORKSPACE) --examples

.PHONY: demo build check test setup format lint docs supply-chain lint-python style-python types-python lint-page wheel release \
	try-release gather-release publish-crates notebooks site fuzz test-fast test-rust test-mujoco test-python \
	test-installed bench clean

demo: build
	$(TDCR) demo --out demo_out

build:
	cargo build --release --locked

# The inner loop: minutes in a built checkout.
check: format lint test-fast

# Everything that must hold at every commit. The Python environment is fetched while the first checks compile, and its types are
# checked, by one processor, while Rust's tests are built: neither needs the other.
test:
	@$(MAKE) setup & setup=$$!; checked=0; $(MAKE) format lint docs || checked=$$?; wait $$setup && exit $$checked
	$(MAKE) -j2 supply-chain lint-page style-python
	@$(MAKE) types-python >target/types.log 2>&1 & types=$$!; tested=0; $(MAKE) test-rust || tested=$$?; \
		wait $$types || tested=$$?; cat target/types.log; exit $$tested
	$(MAKE) wheel
	$(MAKE) -j2 test-mujoco site
	$(MAKE) test-installed

setup:
	@scripts/setup.sh

format:
	cargo fmt --all --check

lint:
	cargo clippy $(WORKSPACE) --all-targets --release --locked -- -D warnings

docs:
	RUSTDOCFLAGS="-D warnings" cargo doc $(WITH_EXAMPLES) --lib --no-deps --release --locked

# That NOTICES names what Cargo.lock has, that deny.toml allows it, and that the wheel and the tests share one build of it.
supply-chain:
	scripts/notices.py --check
	scripts/version.py --check
	scripts/shared_builds.py
	scripts/deny.sh

# What is known of a package's types without PyTorch, which may be missing.
WITHOUT_PYTORCH_TYPES := --ignore-missing-imports --allow-subclassing-any --allow-untyped-decorators \
	--no-warn-unused-ignores --no-warn-return-any

# Style and types of the Python package, its tests and examples.
lint-python: style-python types-python

style-python:
	$(PYTHON) -m ruff format --check
	$(PYTHON) -m ruff check

types-python:
	$(PYTHON) -m mypy $$($(PYTHON) -c 'import torch' 2>/dev/null || echo "$(WITHOUT_PYTORCH_TYPES)")

# Types of the scripts of `tdcr view`'s page.
lint-page:
	scripts/lint_page.sh

# The Python package as a wheel for this machine, in target/wheels, and in the Python environment. `pip install .` builds the
# same; here it shares the build of the dependencies with the tests.
wheel:
	rm -rf target/wheels
	$(PYTHON) -m maturin build --release --locked --interpreter $(PYTHON) --out target/wheels
	$(PYTHON) -m pip install -q --disable-pip-version-check --no-deps --force-reinstall target/wheels/*.whl

# What a release consists of, in dist/, from a clean checkout: wheel, source distribution, the command as a tarball, crates, bill
# of materials, notes, checksums. RELEASE=--no-verify leaves out compiling the packaged crates.
release:
	scripts/release/build.py $(RELEASE)

# That what is in dist/ works where nothing of ours is: the wheel under each CPython that can be had here, the source distribution,
# and the tarball in a bare Debian.
try-release:
	scripts/release/stranger.py

# One dist/ of those that several machines built, in the folders of BUILT.
gather-release:
	scripts/release/gather.py $(BUILT)

# The crates, in the order of their dependencies: needs a token for the registry, and cannot be undone.
publish-crates:
	cargo publish --locked $(WORKSPACE) --exclude tdcr-python

# Runs the notebooks of examples/notebooks and keeps what they print and show.
notebooks:
	$(PYTHON) scripts/notebooks.py

# The documentation of the package and the guides, in target/site.
site:
	$(PYTHON) -m sphinx -W -q -b html docs target/site

# All readers of files for an hour: MINUTES=5 for a shorter run. Not a part of `make test`, which runs the readers on damaged
# files for some seconds.
MINUTES ?= 60
fuzz:
	scripts/fuzz.sh $(MINUTES)

# The librealsense of the Python environment for the tests of RealSense cameras; where there is none, this says why, and they
# are skipped.
REALSENSE = REALSENSE_LIBRARY="$${REALSENSE_LIBRARY-$$($(PYTHON) scripts/realsense_library.py)}"

# Tests within the libraries, and those from outside that take seconds.
test-fast:
	$(REALSENSE) cargo test $(WORKSPACE) --release --locked --lib --test house --test robot
	cargo test $(WORKSPACE) --release --locked --test statics equilibria

# In release mode: the tests settle tens of thousands of robots and train small networks.
test-rust:
	$(REALSENSE) scripts/run_tests.py $(WORKSPACE) --release --locked

# With the MuJoCo of MUJOCO_DIR, or else Debian's; then with the newer one of the Python environment.
# With all packages chosen, the dependencies have the features that they were built with above.
WITH_MUJOCO := --workspace --release --locked
TEST_MUJOCO := cargo test $(WITH_MUJOCO) --test robots --test closed_forms
test-mujoco:
	cargo clippy $(WITH_MUJOCO) --features tdcr/joystick --lib --bin tdcr --test robots --test closed_forms -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc $(WITH_MUJOCO) --examples --lib --no-deps
	$(TEST_MUJOCO)
	MUJOCO_DIR="$$($(PYTHON) -c 'import mujoco; print(mujoco.__path__[0])')" $(TEST_MUJOCO)

test-python: wheel site
	$(MAKE) test-installed

# Of the wheel that is installed. Two processes of one thread each: PyTorch is slow where its threads share busy cores.
test-installed:
	cargo build $(WITH_EXAMPLES) --bins --release --locked
	TDCR=$(TDCR) OMP_NUM_THREADS=1 $(PYTHON) -m pytest -q -rs -n 2 --dist loadfile --no-loadscope-reorder tests/python

# Ours alone, then the tables of ours beside MuJoCo's and, where they are installed, PyTorch's and Gymnasium's; a flow from a
# simulated surface, the real robot of examples/opencr, and what a network adds to it. The table of tracking errors in
# docs/control.md becomes that of this run.
bench: setup wheel
	cargo bench --locked --bench sim --bench metrics --bench peak
	$(PYTHON) benches/peers.py
	$(PYTHON) benches/scenes.py
	$(PYTHON) benches/networks.py
	$(PYTHON) benches/envs.py
	$(PYTHON) benches/bus.py
	$(PYTHON) benches/settling.py
	$(PYTHON) benches/tracking.py $(TDCR) --seeds 10 --into docs/control.md
	$(PYTHON) benches/published_path.py $(TDCR) --trials 1
	$(PYTHON) benches/priors.py target/priors --steps 1000
	$(TDCR) calibrate --robot examples/opencr/robot.toml --columns examples/opencr/columns.toml \
		--data examples/opencr/real_robot_v4_train.csv --validate examples/opencr/real_robot_v4_val.csv \
		--report target/calibration.html
	$(PYTHON) examples/python/residual.py --out target/residual

clean:
	cargo clean
	rm -rf .venv demo_out
