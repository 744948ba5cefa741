# `make` alone prints the targets. `make run` and `make test` set everything up by themselves.
SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

VENV ?= .venv
export VENV
CYCLES_VENV ?= .venv-cycles
export CYCLES_VENV
PYTHON_BIN := $(VENV)/bin/python
SPEC ?= examples/first-run.yaml
PYTEST_OPTIONS ?=
# Real processes, GL and networks on two cores: these limits are for the tests, not for users.
TEST_ENVIRONMENT := OMP_NUM_THREADS=1 OMP_WAIT_POLICY=PASSIVE OPENBLAS_NUM_THREADS=1 LP_NUM_THREADS=0

##@ Use

.PHONY: help
help: ## Print this list
	@awk 'BEGIN {FS = ":.*## "} \
	  /^##@/ {printf "\n%s\n", substr($$0, 5)} \
	  /^[a-z][a-z0-9-]*:.*## / {printf "  make %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

.PHONY: setup
setup: ## Make the virtual environment for running
	@bin/setup run

.PHONY: cycles
cycles: ## Install Blender's Cycles in an environment of its own (1 GB; GPL)
	@bin/cycles

.PHONY: run
run: setup ## Run a validation from a spec (SPEC=examples/first-run.yaml) and show its result
	@exec $(VENV)/bin/valerie run $(SPEC) --end-with-parent

.PHONY: up
up: setup ## Start server, workers and dashboard, and stay until Ctrl-C
	@exec $(VENV)/bin/valerie up --end-with-parent

.PHONY: example-loop
example-loop: setup ## Find a weakness, train against it, compare before and after (var/example-loop/)
	@exec $(PYTHON_BIN) -m examples.retraining.loop

##@ Develop

.PHONY: setup-dev
setup-dev: ## Make the virtual environment for tests and checks
	@bin/setup dev

.PHONY: check
check: setup-dev ## Format, lint, types, import rules
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

.PHONY: format
format: setup-dev ## Format the code
	$(VENV)/bin/ruff check --fix-only --quiet .
	$(VENV)/bin/ruff format .

# Tests of whole systems one after the other on one worker, the others on the second (tests/conftest.py); in the order of the folders,
# so that the long ones begin at once.
TEST_WORKERS = --numprocesses 2 --dist loadscope --no-loadscope-reorder

.PHONY: test
test: setup-dev ## The tests (at most 20 minutes on two cores)
	$(TEST_ENVIRONMENT) $(PYTHON_BIN) -m pytest -m "not slow" $(TEST_WORKERS) $(PYTEST_OPTIONS)

.PHONY: test-all
test-all: setup-dev ## Every test but the containers
	$(TEST_ENVIRONMENT) $(PYTHON_BIN) -m pytest $(TEST_WORKERS) $(PYTEST_OPTIONS)

.PHONY: test-cycles
test-cycles: setup-dev cycles ## The tests of the engine Cycles with a real Blender (small images)
	$(TEST_ENVIRONMENT) VALERIE_TEST_CYCLES_PYTHON=$(CYCLES_VENV)/bin/python \
	  $(PYTHON_BIN) -m pytest tests/cycles $(PYTEST_OPTIONS)

.PHONY: test-compose
test-compose: setup-dev ## Build and run the containers, and a run through them (needs a Docker engine)
	$(PYTHON_BIN) -m pytest tests/compose -s $(PYTEST_OPTIONS)

BENCHES := $(patsubst benchmarks/bench_%.py,%,$(wildcard benchmarks/bench_*.py))
.PHONY: bench
bench: $(addprefix bench-,$(subst _,-,$(BENCHES))) ## Every benchmark; results go to var/bench/

bench-cycles bench-light: cycles

bench-%: setup-dev ## One benchmark, e.g. make bench-render
	@exec $(PYTHON_BIN) -m benchmarks.bench_$(subst -,_,$*)

.PHONY: sensor-strip
sensor-strip: setup-dev ## Make docs/images/sensor.jpg: one frame behind each effect of the sensor stage
	@exec $(PYTHON_BIN) -m tools.sensor_strip

.PHONY: gallery
gallery: setup-dev ## Make docs/images/gallery.jpg and one large picture per engine (Cycles after `make cycles`; minutes)
	@exec $(PYTHON_BIN) -m tools.gallery

.PHONY: clean
clean: ## Remove what tools left; data (var/) and the environment stay
	rm -rf .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis build dist *.egg-info
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +

.PHONY: distclean
distclean: clean ## Remove the environment too
	rm -rf $(VENV) $(CYCLES_VENV)
