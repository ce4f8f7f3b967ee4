# Two targets do everything on a fresh machine: `make run` and `make test`.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Python compiles what it imports: a third of the time that pip takes to compile all there is.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt

# PyTorch's threads would fight those of the other test process; BLAS has one in the package.
export OMP_NUM_THREADS ?= 1

# Compiled Python is kept: hundreds of processes that compile all they import take minutes.
unexport PYTHONDONTWRITEBYTECODE

# Tests run in as many processes; the one that is done takes work from the other.
PARALLEL ?= -n 2 --dist worksteal

# `make fuzz` prints its seed: FUZZ_SEED=... repeats it, FUZZ=... multiplies the number of examples.
FUZZ ?= 10
FUZZ_SEED ?= $(shell $(PYTHON) -c 'import secrets; print(1 + secrets.randbelow(10**9))')

.PHONY: run test fuzz slow lint demos pictures docs suite bench ngspice clean

run: $(VENV)/run.stamp  ## solve the paper's example; pictures and result.json in out/
	$(BIN)/ann-dc paper --output out

test: $(VENV)/test.stamp ngspice  ## lint, doctests and tests, two at a time
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m pytest -m "not slow" $(PARALLEL)

slow: $(VENV)/test.stamp ngspice  ## the tests that CI has no time for (minutes)
	$(BIN)/python -m pytest -m slow $(PARALLEL)

fuzz: $(VENV)/test.stamp ngspice  ## property tests with ten times as many examples, from a new seed (an hour)
	@seed=$(FUZZ_SEED); echo "make fuzz FUZZ=$(FUZZ) FUZZ_SEED=$$seed"; \
	FUZZ=$(FUZZ) FUZZ_SEED=$$seed $(BIN)/python -m pytest -m property $(PARALLEL)

lint: $(VENV)/dev.stamp  ## everything static, with pyright
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

demos: $(VENV)/test.stamp  ## every demo, into out/demos/
	for demo in demos/[0-9]*.py; do $(BIN)/python $$demo || exit 1; done

pictures: demos  ## the same, into the gallery
	$(BIN)/python tests/pictures.py

docs: $(VENV)/test.stamp  ## guide and reference as HTML into out/docs/; a warning is an error
	$(BIN)/python -m sphinx -W --keep-going -q -d out/doctrees demos/guide out/docs

suite: $(VENV)/test.stamp  ## 23 problems x 5 starts, and the frozen networks (minutes)
	PYTHONPATH=tests $(BIN)/python -m bench.suite

bench: $(VENV)/test.stamp ngspice  ## measure and write tests/bench/README.md (an hour); BENCHES="kernel circuits" for two
	PYTHONPATH=tests $(BIN)/python -m bench.record $(BENCHES)

# The circuit simulator is a Debian package; without the right to install it, its tests are skipped.
ngspice:
	@command -v ngspice >/dev/null || { \
	  if [ "$$(id -u)" = 0 ]; then run=; else run="sudo -n"; fi; \
	  $$run apt-get update -qq && $$run apt-get install -y -qq ngspice >/dev/null; } \
	  || echo "ngspice is not here and could not be installed: the tests that simulate circuits are skipped"

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or later is needed")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/run.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(INSTALL) -e .
	touch $@

$(VENV)/test.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(INSTALL) -e '.[test]'
	touch $@ $(VENV)/run.stamp

$(VENV)/dev.stamp: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(INSTALL) -e '.[dev]'
	touch $@ $(VENV)/test.stamp $(VENV)/run.stamp

clean:
	rm -rf $(VENV) out build dist .pytest_cache .ruff_cache .hypothesis
