# Two commands for a newcomer: `make demo` and `make test`. Each is enough on its own.
VENV   := .venv
PYTHON := $(VENV)/bin/python
# A python3.13 on PATH that really runs (a pyenv shim may not), else pyenv's newest 3.13.
FIND_PYTHON := for p in python3.13 $$(ls -d $${PYENV_ROOT:-$$HOME/.pyenv}/versions/3.13*/bin/python3.13 2>/dev/null | sort -V -r); do \
	"$$p" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 13))' 2>/dev/null && { echo "$$p"; exit 0; }; done; exit 1

# Panics name source files: of this repository, of cargo's crates and of Rust, not of whoever built them.
export RUSTFLAGS := $(RUSTFLAGS) --remap-path-prefix=$(CURDIR)=strata --remap-path-prefix=$(or $(CARGO_HOME),$(HOME)/.cargo)=cargo \
	--remap-path-prefix=$(or $(RUSTUP_HOME),$(HOME)/.rustup)=rustup

.PHONY: setup demo test test-unit test-devices test-window test-interface lint bench report docs extension clean

setup: $(VENV)/.kernels docs

$(VENV)/.packages: requirements.txt
	@python=$$($(FIND_PYTHON)) || { echo "Strata needs Python 3.13: put python3.13 on PATH, or run 'pyenv install 3.13'." >&2; exit 2; }; \
	test -x $(PYTHON) || "$$python" -m venv $(VENV)
	$(PYTHON) -m pip install --quiet --require-hashes -r requirements.txt
	@touch $@

$(VENV)/.kernels: $(VENV)/.packages pyproject.toml kernels/Cargo.toml kernels/Cargo.lock kernels/pyproject.toml $(shell find kernels/src -name '*.rs')
	@command -v cargo >/dev/null || { echo "Strata needs Rust (cargo) to build its kernels: see https://rustup.rs." >&2; exit 2; }
	cd kernels && PYO3_PYTHON=$(abspath $(PYTHON)) ../$(PYTHON) -m maturin build --release --locked --quiet --out ../dist/wheels --interpreter ../$(PYTHON)
	$(PYTHON) -m pip install --quiet --no-index --no-deps --force-reinstall dist/wheels/strata_kernels-*.whl
	$(PYTHON) -m pip install --quiet --no-build-isolation --no-deps --no-index --editable .
	@touch $@

demo: setup
	$(PYTHON) -m strata.scripts.demo

# Two files of tests at a time: much of a test is one thread's work.
PYTEST := $(PYTHON) -m pytest --numprocesses 2 --dist loadfile

test: setup
	$(PYTEST)

# The same in parts, as CI runs it; in a window one by one, since a person waits there.
test-unit: setup
	$(PYTEST) $(addprefix tests/,core kernels measure report scene layers audit ui preview ops scripts)

test-devices: setup
	$(PYTEST) $(addprefix tests/,devices effects bake engine cycles)

test-window: setup
	$(PYTHON) -m pytest tests/window

# In a Blender window under Xvfb: make test-interface BLENDER=/path/to/blender; photographs in out/interface.
test-interface: setup
	@test -x "$(BLENDER)" || { echo "Name a Blender 5.2: make test-interface BLENDER=/path/to/blender" >&2; exit 2; }
	BLENDER="$(BLENDER)" $(PYTHON) -m pytest tests/window/test_interface.py tests/window/test_story.py

# Both formatters and linters; nothing is changed.
lint: setup
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	cd kernels && cargo fmt --check
	cd kernels && PYO3_PYTHON=$(abspath $(PYTHON)) cargo clippy --locked --all-targets --quiet -- -D warnings

bench: setup
	$(PYTHON) -m strata.scripts.bench.performance

# docs/report: error against time of every sample scene.
report: setup
	$(PYTHON) -m strata.scripts.reports

# docs/effects and the presets, from what the effects declare; no part of the repository.
docs: $(VENV)/.kernels
	@$(PYTHON) -m strata.scripts.build.effect_docs
	@$(PYTHON) -m strata.scripts.build.effect_presets

# dist/strata-<version>-linux_x64.zip, to install from a file in Blender's preferences.
extension: setup
	$(PYTHON) -m strata.scripts.build.extension

clean:
	rm -rf $(VENV) out dist build docs/effects addon/ui/presets *.egg-info kernels/target .pytest_cache .ruff_cache .hypothesis
