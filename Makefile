# eomgen: what can be run here.  Everything happens in .venv; nothing else on the machine is touched.
#
#   make demo       derive, compile, simulate and plot the 36-DOF elastic PUMA 560; results in out/demo; under 1 minute
#   make test       the quick tests: every package, without optional libraries; under 4 minutes from a fresh clone
#   make test-all   lint and the whole test suite, quick tests included; 13 minutes more; 8 with warm caches
#   make soak       the long tests, with a few cases of each; under 60 minutes; writes docs/soak.md.
#                   EOMGEN_SOAK=all make soak runs every case: hours
#   make lint       ruff (lint and format), mypy --strict, and which package may import which
#   make coverage   lines of each package that the quick tests run; COVERAGE_TESTS= for the whole suite
#   make bench      counts, times, precision compared with Newton-Euler, Pinocchio, MuJoCo, CasADi, Exudyn, SciPy
#   make mutation   mutation tests of every package and of the derivation; writes docs/mutation.md
#   make size       write docs/size.md: lines, bytes and syntax-tree nodes per package, compared with the budgets
#   make compare    COMMIT=... ROWS="...": operation counts, and ratios of times, compared with a commit
#   make docs       build the documentation into out/site: open index.html there; warnings are errors
#   make notebooks  run the notebooks of examples/notebooks; copies with all results in out/notebooks
#   make sample     regenerate the committed sample in generated/one_link
#   make tables     regenerate the tables in docs/architecture.md, docs/comparison.md, docs/start.md and others
#   make picture    simulate and draw the pictures of README.md and of the harmonic drive
#   make packages   write the list of packages in pyproject.toml, after a folder of code was added, renamed or removed
#   make methods    write the coefficients of integration methods for C, tableaus.h and explicit_tableaus.h of src/eomgen/clib
#   make schemas    regenerate the JSON Schemas in src/eomgen/schemas
#   make operations regenerate src/eomgen/clib/operations.h from the table of operations
#   make claims     run the commands behind the figures of README and docs that take less than an hour
#   make misra      what MISRA C finds in generated code and in the C library; writes the tables of two pages in docs
#   make wheel      build the source distribution and the wheel into dist/, and check what an index would show of them
#   make release    build both, check versions, try them in fresh environments of Python 3.11 to 3.14 (PYTHONS="3.11 3.12")
#   make clean      remove what the commands above made

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
unexport PYTHONDONTWRITEBYTECODE  # compiling eomgen is half of the time of a process that has no bytecode

# Python compiles a module when it is first imported; pip would compile all 15,000, one after the other.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
# One thread of BLAS per test worker: workers that each use all cores disturb one another.
test test-all soak coverage: export OPENBLAS_NUM_THREADS := 1
PYTEST := MAKEFLAGS= $(BIN)/python -m pytest -n auto --dist worksteal
COVERAGE_TESTS := -m "quick and not soak"
# What the extra "wheel" lists, without eomgen and what it needs to run.
WHEEL_TOOLS := $(shell sed -n 's/^wheel = \[\(.*\)\]$$/\1/p' pyproject.toml | tr ',' ' ')

.PHONY: help demo test test-all lint types coverage size compare bench soak mutation claims docs notebooks sample tables picture \
   packages methods schemas operations misra wheel release clean

help:
	@sed -n 's/^#   //p' Makefile

demo: $(VENV)/.sim
	$(BIN)/eomgen info puma560_elastic
	$(BIN)/eomgen simulate puma560_elastic -o out/demo

test: $(VENV)/.test
	$(PYTEST) -m "quick and not soak"

test-all: lint
	$(PYTEST)

lint: $(VENV)/.test-all types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy -p eomgen
	PYTHONPATH=$(VENV)/types $(BIN)/lint-imports
	$(BIN)/python -m tests.support.first_words

# One package for what follows imports without importing: links to src/eomgen, codegen and templates.
types: | $(BIN)/python
	$(BIN)/python -m release.packages --links $(VENV)/types

coverage: $(VENV)/.coverage
	$(PYTEST) $(COVERAGE_TESTS) --cov=src/eomgen --cov=codegen --cov-report=
	$(BIN)/python -m benchmarks.coverage

size: $(VENV)/.sim
	$(BIN)/python -m benchmarks.size --page

compare: $(VENV)/.bench
	$(BIN)/python -m benchmarks.compare $(COMMIT) $(ROWS)

bench: $(VENV)/.bench
	$(BIN)/python benchmarks/run.py
	$(BIN)/python -m benchmarks.arrays
	$(BIN)/python -m benchmarks.batches
	$(BIN)/python -m benchmarks.bits
	$(BIN)/python -m benchmarks.builds
	$(BIN)/python -m benchmarks.calibrating
	$(BIN)/python -m benchmarks.closed
	$(BIN)/python -m benchmarks.friction
	$(BIN)/python -m benchmarks.global_error
	$(BIN)/python -m benchmarks.jets
	$(BIN)/python -m benchmarks.levels
	$(BIN)/python -m benchmarks.observers
	$(BIN)/python -m benchmarks.peers
	$(BIN)/python -m benchmarks.precision
	$(BIN)/python -m benchmarks.rounding
	$(BIN)/python -m benchmarks.rotor
	$(BIN)/python -m benchmarks.threads
	$(BIN)/python -m benchmarks.wasm
	$(BIN)/python docs/tables.py

soak: $(VENV)/.test-all
	$(BIN)/python -m pytest -n auto --dist worksteal -m soak --soak-page=docs/soak.md

docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

notebooks: $(VENV)/.docs
	$(BIN)/python docs/generators/notebooks.py out/notebooks

mutation: $(VENV)/.mutation
	nice -n 10 $(BIN)/python -m benchmarks.mutation derivation --sample 100
	nice -n 10 $(BIN)/python -m benchmarks.mutation record
	nice -n 10 $(BIN)/python -m benchmarks.mutation packages

claims: $(VENV)/.bench
	$(BIN)/python -m benchmarks.claims

sample: $(VENV)/.sim
	$(BIN)/eomgen generate one_link -o generated

tables: sample
	$(BIN)/python docs/tables.py

picture: $(VENV)/.sim
	$(BIN)/python docs/picture.py
	$(BIN)/python docs/hysteresis.py

packages:
	$(PYTHON) -m release.packages

methods: $(VENV)/.sim
	$(BIN)/python -m eomgen.codegen.c.tableaus src/eomgen/clib

operations: $(VENV)/.sim
	$(BIN)/python -m eomgen.codegen.c.functions > src/eomgen/clib/operations.h

schemas: $(VENV)/.sim
	for name in robot scenario plan; do $(BIN)/eomgen schema $$name > src/eomgen/schemas/$$name.schema.json; done

misra: $(VENV)/.test-all
	$(BIN)/python docs/misra.py

wheel: $(VENV)/.wheel
	rm -rf build/lib dist
	$(BIN)/python -m build
	$(BIN)/twine check --strict dist/*

release: $(VENV)/.wheel
	$(BIN)/python -m release $(if $(PYTHONS),--pythons $(PYTHONS))

clean:
	rm -rf $(VENV) build dist out src/*.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

# Environments by extra; a larger one serves what needs a smaller one.
$(VENV)/.sim: pyproject.toml | $(BIN)/python
	$(PIP) -e '.[sim]'
	touch $@

$(VENV)/.test: pyproject.toml | $(BIN)/python
	$(PIP) -e '.[test]'
	touch $@ $(VENV)/.sim

$(VENV)/.test-all: pyproject.toml | $(BIN)/python
	$(PIP) -e '.[test-all]'
	touch $@ $(VENV)/.test $(VENV)/.docs $(VENV)/.sim

$(VENV)/.coverage: pyproject.toml | $(BIN)/python
	$(PIP) -e '.[test,coverage]'
	touch $@ $(VENV)/.test $(VENV)/.sim

$(VENV)/.docs: pyproject.toml | $(BIN)/python
	$(PIP) -e '.[docs]'
	touch $@ $(VENV)/.sim

$(VENV)/.bench: pyproject.toml | $(BIN)/python
	$(PIP) -e '.[test-all,bench]'
	touch $@ $(VENV)/.test-all $(VENV)/.test $(VENV)/.docs $(VENV)/.sim

$(VENV)/.wheel: pyproject.toml | $(BIN)/python
	$(PIP) $(WHEEL_TOOLS)
	touch $@

$(VENV)/.mutation: pyproject.toml | $(BIN)/python
	$(PIP) -e '.[mutation]'
	touch $@ $(VENV)/.test-all $(VENV)/.test $(VENV)/.docs $(VENV)/.sim
