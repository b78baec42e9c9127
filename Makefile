# Every verb works on a fresh clone: it needs Python 3.11 or newer, a C toolchain and Rust.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
SECONDS ?= 300
CORE   := Cargo.toml pyproject.toml $(wildcard Cargo.lock crates/*/Cargo.toml) $(shell find crates -name '*.rs' -o -name 'table.txt')
# With the extension beside them the tests share what is compiled for it.
RUST_TESTS := -p liouville-py -p liouville-tests
# The core is compiled while pip fetches what is Python, and is taken from there by the build that pip makes.
COMPILE := cargo build --quiet --release -p liouville-py
# It finds there what it asks for where PyO3 is told the same by both: the stable ABI, which no interpreter is asked about.
export PYO3_BUILD_EXTENSION_MODULE := 1
export PYO3_CONFIG_FILE := $(CURDIR)/crates/py/stable_abi.txt
# Modules are compiled once and not by every process, and workers do not compete by their threads.
PYTEST_SETTINGS := PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1
SPHINX := $(BIN)/sphinx-build -W --keep-going -q

.DEFAULT_GOAL := help
.PHONY: help demo test kernels slow fuzz sanitize lint format build docs links wheel tryout bench ci clean

help:  ## Print the verbs
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | awk -F '\t' '{printf "make %-8s %s\n", $$1, $$2}'

demo:  ## Build, integrate two mechanisms, compare with references, draw build/demo.png
	@$(COMPILE) & $(MAKE) --no-print-directory $(VENV)/demo && wait
	$(BIN)/python examples/demo.py

test:  ## Run every test but the slow ones: Rust, Python, examples in the documentation
	@cargo test --quiet --release --no-run $(RUST_TESTS) & $(MAKE) --no-print-directory $(VENV)/tools && wait
	cargo test --quiet --release $(RUST_TESTS)
	$(PYTEST_SETTINGS) $(BIN)/python -m pytest -q -n logical --dist worksteal

kernels: $(VENV)/tools  ## Run the tests that compare with other codes, or bits, under two BLAS kernels
	$(PYTEST_SETTINGS) $(BIN)/python tools/kernels.py -- -n logical --dist worksteal

slow: $(VENV)/tools  ## Run the tests that take longer than a minute each: hours
	$(PYTEST_SETTINGS) $(BIN)/python -m pytest -q -m slow -n logical --dist worksteal

fuzz: $(VENV)/tools  ## Try the properties with new seeds for SECONDS=300, and print what to replay
	$(BIN)/python tools/fuzz.py $(SECONDS)

sanitize: $(BIN)/python  ## Run the core's tests under the address and thread sanitizers and Miri, as far as Rust has them
	$(BIN)/python tools/sanitize.py

lint: $(VENV)/tools  ## Check only: rustfmt, clippy, ruff, mypy, stubtest
	cargo fmt --all --check
	cargo clippy --quiet --workspace --all-targets -- -D warnings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	MYPYPATH=python $(BIN)/stubtest --concise liouville._core

format: $(VENV)/tools  ## Rewrite the sources as lint wants them
	cargo fmt --all
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

build: $(VENV)/built  ## Compile the core and install liouville into .venv, with all extras but bench

docs: $(VENV)/tools  ## Build the documentation into docs/_build/html; runs the gallery
	$(SPHINX) docs docs/_build/html

# Addresses of other sites change without our doing, so no change waits for them: a job of each week looks.
links: $(VENV)/tools  ## Ask every address that the documentation names; needs the network
	$(BIN)/sphinx-build -q -b linkcheck docs docs/_build/links

define CHECK_WHEEL
	$(BIN)/python -m twine check --strict dist/*
	$(BIN)/python tools/check_wheel.py dist/*.whl dist/*.tar.gz
endef

# The wheel is built from the sdist, as pip would; what it is compiled from stays in target/ for the next time.
wheel: $(VENV)/tools  ## Build sdist and wheel into dist/, and try them in fresh environments without Rust
	rm -rf dist
	$(PIP_INSTALL) --group package
	CARGO_TARGET_DIR=$(CURDIR)/target $(BIN)/python -m build
	$(CHECK_WHEEL)

# The wheel of `make wheel` but for optimisation across crates, which takes ten minutes: the core is compiled by now.
tryout: $(VENV)/tools  ## The same with the core as the tests have it, in two minutes
	rm -rf dist
	$(PIP_INSTALL) --group package
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist --config-settings=build-args='--profile release' .
	$(BIN)/python -m build --sdist --outdir dist >/dev/null
	$(CHECK_WHEEL)

bench: $(VENV)/bench  ## Measure beside other codes, in under ten minutes; tables in build/measured
	$(BIN)/python benchmarks/work_precision.py --short
	$(BIN)/python benchmarks/ensembles.py --members 10000
	$(BIN)/python benchmarks/rattle_chain.py --openmm
	$(BIN)/python benchmarks/mujoco_chain.py

ci: lint test kernels docs tryout  ## Run all checks, as .ci/run does

clean:  ## Remove what the verbs made
	rm -rf $(VENV) target build dist docs/_build docs/gallery python/liouville/_core*.so

# The package is installed in place: a change in Python needs no new build, one in Rust does.
PIP_INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile

$(BIN)/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "liouville needs Python 3.11 or newer")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/demo: $(BIN)/python $(CORE)
	$(PIP_INSTALL) -e '.[plot]'
	@touch $@

$(VENV)/built: $(BIN)/python $(CORE)
	$(PIP_INSTALL) -e '.[all]'
	@touch $(VENV)/demo $@

$(VENV)/bench: $(BIN)/python $(CORE)
	$(PIP_INSTALL) 'pip>=25.1'
	$(PIP_INSTALL) -e '.[all]' --group bench
	@touch $(VENV)/demo $(VENV)/built $@

$(VENV)/tools: $(BIN)/python $(CORE)
	$(PIP_INSTALL) 'pip>=25.1' # it knows groups
	$(PIP_INSTALL) -e '.[all]' --group test --group lint
	@touch $(VENV)/demo $(VENV)/built $@
