# `make` alone lists the targets. `make run` and `make test` set up their environment.
SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

VENV ?= .venv
export VENV
CYCLES_VENV ?= .venv-cycles
export CYCLES_VENV
PYTHON_BIN := $(VENV)/bin/python
SPEC ?= examples/first-run.yaml
TAG ?=
PYTEST_OPTIONS ?=
# Limits for the tests, which run processes, GL and networks on two cores; users have none. Bytecode is kept even where the
# shell forbids it: some hundred processes would compile all sources again.
TEST_ENVIRONMENT := OMP_NUM_THREADS=1 OMP_WAIT_POLICY=PASSIVE OPENBLAS_NUM_THREADS=1 LP_NUM_THREADS=0 \
  PYTHONDONTWRITEBYTECODE=

##@ Use

.PHONY: help
help: ## Print this list
	@awk 'BEGIN {FS = ":.*## "} \
	  /^##@/ {printf "\n%s\n", substr($$0, 5)} \
	  /^[a-z][a-z0-9-]*:.*## / {printf "  make %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

.PHONY: setup
setup: ## Create the virtual environment for running
	@bin/setup run

.PHONY: cycles
cycles: ## Install Blender's Cycles in its own environment (1 GB; GPL)
	@bin/cycles

.PHONY: run
run: setup ## Run a validation and show its result (SPEC=examples/first-run.yaml)
	@exec $(VENV)/bin/valerie run $(SPEC) --end-with-parent

.PHONY: paper-small
paper-small: setup ## Run a small part of the paper's experiment and test the paper's claims on it (minutes)
	@exec $(VENV)/bin/valerie run examples/paper-small.yaml --claims examples/claims/paper.yaml --end-with-parent

.PHONY: paper-part
paper-part: setup ## Run two of the eight headings of the paper's experiment at full size (hours) and renew docs/experiment/
	@exec $(PYTHON_BIN) -m tools.paper part

.PHONY: paper-streets
paper-streets: setup ## Repeat a part on ten streets (2 to 4 CPU hours) and renew docs/experiment/
	@exec $(PYTHON_BIN) -m tools.paper streets

.PHONY: paper-light
paper-light: setup ## Run a part with the light on each person (10 CPU minutes) and renew docs/experiment/
	@exec $(PYTHON_BIN) -m tools.paper light

.PHONY: paper-cycles
paper-cycles: setup cycles ## Run a part by Cycles, too (an hour) and renew docs/experiment/
	@exec $(PYTHON_BIN) -m tools.paper cycles

.PHONY: guided
guided: setup ## Ask a failure rate, a boundary, pairs and a ranking of one domain (half an hour) and renew docs/guided/
	@exec $(PYTHON_BIN) -m tools.guided

.PHONY: up
up: setup ## Start server, workers and dashboard until Ctrl-C
	@exec $(VENV)/bin/valerie up --end-with-parent

.PHONY: example-loop
example-loop: setup ## Find a weakness, fine-tune, compare before and after (var/example-loop/)
	@exec $(PYTHON_BIN) -m examples.retraining.loop

##@ Develop

.PHONY: setup-dev
setup-dev: ## Create the virtual environment for tests and checks
	@bin/setup dev

.PHONY: check
check: setup-dev ## Check format, lint, types and import rules
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

.PHONY: format
format: setup-dev ## Format the code
	$(VENV)/bin/ruff check --fix-only --quiet .
	$(VENV)/bin/ruff format .

# Three workers fill two cores: one runs the tests of whole systems, which often wait, the others all other tests
# (tests/conftest.py), in the order of the folders, so that the long ones begin at once.
TEST_WORKERS = --numprocesses 3 --dist loadscope --no-loadscope-reorder

.PHONY: test
test: setup-dev ## Run the tests but those of the browser (minutes)
	$(TEST_ENVIRONMENT) $(PYTHON_BIN) -m pytest -m "not slow and not browser" $(TEST_WORKERS) $(PYTEST_OPTIONS)

.PHONY: test-wheel
test-wheel: setup-dev ## Build the wheel, install it without the sources and run its example (minutes)
	$(TEST_ENVIRONMENT) $(PYTHON_BIN) -m pytest tests/integration/test_wheel.py $(PYTEST_OPTIONS)

.PHONY: test-browser
test-browser: setup-dev ## Test the dashboard in Chromium, with axe-core on every page (minutes)
	$(TEST_ENVIRONMENT) $(PYTHON_BIN) -m pytest -m browser tests/integration $(PYTEST_OPTIONS)

SCHEDULES ?= 10000
.PHONY: test-simulation
test-simulation: setup-dev ## Try 10,000 seeded schedules of faults on the control plane (SCHEDULES=100)
	$(PYTHON_BIN) -m tests.simulation --schedules $(SCHEDULES) --processes 2

.PHONY: chaos
chaos: SCHEDULES = 10
chaos: setup-dev ## Disturb real processes by seeded schedules of faults, on SQLite and Postgres (half an hour; SEED=1 SCHEDULES=10)
	@exec $(PYTHON_BIN) -m tests.chaos --seed $(or $(SEED),1) --schedules $(SCHEDULES)

# Seeds are spread over two processes.
SPECS ?= 20000
.PHONY: test-hostile
test-hostile: setup-dev ## Plan 20,000 damaged specs over REST (SPECS=100)
	$(PYTHON_BIN) -m tests.hostile --specs $$(($(SPECS) / 2)) & \
	$(PYTHON_BIN) -m tests.hostile --specs $$(($(SPECS) / 2)) --first $$(($(SPECS) / 2 + 1)); \
	  result=$$?; wait $$! && exit $$result

SCENARIOS ?= 30
.PHONY: test-stateful
test-stateful: setup-dev ## Send 30 scenarios of linked requests to the API, on SQLite and on Postgres (SCENARIOS=100)
	$(TEST_ENVIRONMENT) VALERIE_TEST_SCENARIOS=$(SCENARIOS) $(PYTHON_BIN) -m pytest tests/integration/test_api_stateful.py $(PYTEST_OPTIONS)

.PHONY: test-all
test-all: setup-dev ## Run every test but the containers
	$(TEST_ENVIRONMENT) $(PYTHON_BIN) -m pytest $(TEST_WORKERS) $(PYTEST_OPTIONS)

.PHONY: test-cycles
test-cycles: setup-dev cycles ## Test the engine Cycles with a real Blender (small images)
	$(TEST_ENVIRONMENT) VALERIE_TEST_CYCLES_PYTHON=$(CYCLES_VENV)/bin/python \
	  $(PYTHON_BIN) -m pytest tests/cycles $(PYTEST_OPTIONS)

# The validator's libraries conflict with ours.
.PHONY: test-rocrate
test-rocrate: setup-dev ## Check with roc-validator that evidence is a valid RO-Crate
	test -x .venv-rocrate/bin/rocrate-validator || { $(PYTHON_BIN) -m venv .venv-rocrate && \
	  .venv-rocrate/bin/pip install --quiet roc-validator==0.13.0 rocrate==0.16.0; }
	$(TEST_ENVIRONMENT) VALERIE_TEST_ROCRATE_PYTHON=$(CURDIR)/.venv-rocrate/bin/python \
	  $(PYTHON_BIN) -m pytest tests/rocrate $(PYTEST_OPTIONS)

# The environment of these tools is not the one that they look at.
.venv-sbom: setup-dev
	test -x .venv-sbom/bin/pip-audit || { $(PYTHON_BIN) -m venv .venv-sbom && \
	  .venv-sbom/bin/pip install --quiet cyclonedx-bom==7.5.0 pip-audit==2.10.1; }

.PHONY: sbom
sbom: .venv-sbom ## List all installed packages with versions and licences in var/sbom.json (CycloneDX)
	mkdir -p var
	.venv-sbom/bin/cyclonedx-py environment --output-reproducible --output-file var/sbom.json $(PYTHON_BIN)

.PHONY: release
release: .venv-sbom ## Build wheel, SBOM and checksums of a tag into dist/, each time with the same bytes (TAG=v0.1.0)
	test -n "$(TAG)" || { echo "make release: name a tag: TAG=v0.1.0" >&2; exit 2; }
	rm -rf dist && bin/release $(TAG) dist
	git show $(TAG):constraints.txt > dist/constraints.txt
	.venv-sbom/bin/cyclonedx-py requirements --output-reproducible --output-file dist/sbom.json dist/constraints.txt
	cd dist && sha256sum * > SHA256SUMS

# pip-audit writes its file only if it has looked at every package and found something.
.PHONY: audit
audit: .venv-sbom ## Look for known vulnerabilities of the pinned versions (needs pypi.org); they go to var/audit.txt
	mkdir -p var && rm -f var/audit.txt
	.venv-sbom/bin/pip-audit --strict --no-deps --disable-pip --progress-spinner off --output var/audit.txt \
	  -r constraints.txt || { cat var/audit.txt 2>/dev/null || \
	  echo "audit: pypi.org did not answer for every package: NOTHING is known about vulnerabilities" >&2; exit 1; }

.PHONY: test-cluster
test-cluster: setup-dev ## Test Slurm, RabbitMQ and the files for Kubernetes (needs slurm-wlm munge rabbitmq-server kubernetes-client prometheus)
	$(TEST_ENVIRONMENT) $(PYTHON_BIN) -m pytest tests/cluster $(PYTEST_OPTIONS)

.PHONY: test-compose
test-compose: setup-dev ## Build the containers and send a run through them (needs a Docker engine)
	$(PYTHON_BIN) -m pytest tests/compose -s $(PYTEST_OPTIONS)

BENCHES := $(patsubst benchmarks/bench_%.py,%,$(wildcard benchmarks/bench_*.py))
.PHONY: bench
bench: $(addprefix bench-,$(subst _,-,$(BENCHES))) ## Run every benchmark; results go to var/bench/

bench-cycles bench-light bench-person-light: cycles

bench-%: setup-dev ## Run one benchmark, e.g. make bench-render
	@exec $(PYTHON_BIN) -m benchmarks.bench_$(subst -,_,$*)

.PHONY: sensor-strip
sensor-strip: setup-dev ## Render docs/images/sensor.jpg: one frame behind each effect of the sensor stage
	@exec $(PYTHON_BIN) -m tools.sensor_strip

.PHONY: flora
flora: setup-dev ## Render docs/images/trees.jpg and signs.jpg: kinds of trees, faces of traffic signs
	@exec $(PYTHON_BIN) -m tools.flora_pictures

# Only this step needs resvg, npm and the drawings.
.PHONY: sign-faces
sign-faces: ## Rasterise the faces of traffic signs again (npm)
	test -x .venv-signs/bin/python || { python3 -m venv .venv-signs && \
	  .venv-signs/bin/pip install --quiet resvg-py==0.5.0 numpy pillow scipy shapely; }
	@exec .venv-signs/bin/python -m tools.sign_faces

.PHONY: vehicles
vehicles: setup-dev ## Write the index of vehicles, and render docs/images/vehicles.jpg (a minute)
	@$(PYTHON_BIN) -m tools.vehicle_index
	@exec $(PYTHON_BIN) -m tools.vehicle_sheet

.PHONY: gallery
gallery: setup-dev ## Render docs/images/gallery.jpg, places.jpg, one large picture per engine (minutes; Cycles after `make cycles`)
	@$(PYTHON_BIN) -m tools.gallery && exec $(PYTHON_BIN) -m tools.place_sheet

.PHONY: people
people: setup-dev ## Render docs/images/people.jpg: every character and pose of the street's people (minutes)
	@exec $(PYTHON_BIN) -m tools.people

.PHONY: screenshots
screenshots: setup-dev ## Take pictures of docs/images/ from the first run, most of the dashboard (minutes; Chromium)
	@exec $(PYTHON_BIN) -m tools.screenshots

.PHONY: notebook
notebook: setup-dev ## Execute examples/notebook.ipynb and render it as docs/notebook.md
	@exec $(PYTHON_BIN) -m tools.notebook

.PHONY: clean
clean: ## Remove caches and build outputs; data (var/) and the environment stay
	rm -rf .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis build dist *.egg-info
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +

.PHONY: distclean
distclean: clean ## Remove the environments too
	rm -rf $(VENV) $(CYCLES_VENV) .venv-rocrate .venv-sbom
