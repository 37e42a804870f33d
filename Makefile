# Each target sets up .venv by itself, and again when pyproject.toml changes.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# Empty, the package is installed as its wheel has it: so continuous integration tests it.
EDITABLE ?= --editable
PYTHONS ?= python3.11 python3.12 python3.13
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help demo test quick check format bench bench-quick side-by-side feedback soak sweep identified shield reach joints rhythms obstacles hard-use kills fuzz wheels docs pictures clean

help: ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:[^#]*##/\t/' | expand -t 10

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("noslip needs Python 3.11 or newer; choose one with: make PYTHON=python3.12 ...") if sys.version_info < (3, 11) else None'
	@echo "Setting up $(VENV) (once, and again when pyproject.toml changes) ..."
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet $(EDITABLE) .
	@touch $@

# All extras, the linters and the test tools: about 1.5 GB.
$(VENV)/.dev: $(STAMP)
	@echo "Installing what the tests need ..."
	$(BIN)/python -m pip install --quiet $(EDITABLE) '.[dev]'
	@touch $@

$(VENV)/.bench: $(STAMP)
	$(BIN)/python -m pip install --quiet $(EDITABLE) '.[bench]'
	@touch $@

demo: $(STAMP) ## run the paper's experiments; results in noslip-demo/
	$(BIN)/noslip demo --out noslip-demo

test: $(VENV)/.dev ## run all tests
	$(BIN)/python -m pytest --numprocesses auto --dist worksteal

quick: $(VENV)/.dev ## run the fast tests only
	$(BIN)/python -m pytest --numprocesses auto --dist worksteal -m "not slow"

check: $(VENV)/.dev ## lint, format and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/.dev ## put the code into the house's format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(VENV)/.bench ## measure against the paper's method and movement-primitives
	$(BIN)/python -m benchmarks --out benchmarks/results.json
	$(BIN)/python -m benchmarks.feedback --quick

bench-quick: $(VENV)/.bench ## the ratios that must not fall, in two minutes; GATE=--gate fails where one has
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.gate $(GATE)

side-by-side: $(VENV)/.bench ## other libraries at the same job, those that are installed; AUTHORS=FOLDER adds the paper's code
	$(BIN)/python -m benchmarks.side_by_side $(if $(AUTHORS),--authors $(AUTHORS))

feedback: $(VENV)/.bench ## controllers on robots that are not ideal, against bounds and others; hours
	$(BIN)/python -m benchmarks.feedback --gate --json benchmarks/feedback.json

soak: $(STAMP) ## step the exported C code 1e8 times and look for what must never happen
	$(BIN)/python -m benchmarks.soak --steps 100000000

sweep: $(STAMP) ## hold what is said of 2000 random jobs against their files
	$(BIN)/python -m benchmarks.sweep --jobs 2000

hard-use: $(VENV)/.dev ## what strangers, rules, disks and numbers must not do; a table of trials at the end
	$(BIN)/python -m pytest tests/hard_use

identified: $(VENV)/.dev ## 100 random tools of each kind and noise, and what is told of them; an hour
	NOSLIP_WORLDS=100 $(BIN)/python -m pytest tests/identification/test_table.py --capture=no --quiet

shield: $(STAMP) ## send noisy chunks of recorded tools through a shield, 1e5 of them; an hour
	$(BIN)/python -m benchmarks.shield --chunks 100000

reach: $(STAMP) ## adapt to 1300 goals all around, by maneuvers where it takes them; an hour
	$(BIN)/python -m benchmarks.reach --count 500

joints: $(VENV)/.dev ## recorded contours as joints of an arm, whose tool must not slip; ten minutes
	$(BIN)/python -m benchmarks.joints

rhythms: $(VENV)/.bench ## 1e4 periods under a blade or a wheel, other frequencies, and pydmps; ten minutes
	$(BIN)/python -m benchmarks.rhythms

obstacles: $(VENV)/.bench ## ways around obstacles beside OMPL's planners, a quarter of an hour; SCENARIOS=FOLDER adds street maps
	$(BIN)/python -m benchmarks.obstacles $(if $(SCENARIOS),--scenarios $(SCENARIOS))

kills: $(STAMP) ## kill processes that write into one folder and one cache, 1000 rounds of 2 and of 10
	$(BIN)/python -m benchmarks.kills --rounds 1000

fuzz: $(VENV)/.dev ## damage primitives, tables, bags and what exported C is given at random, 1e6 times each; hours
	for target in primitive tables bags exported; do $(BIN)/python -m benchmarks.fuzz $$target --executions 1000000 || exit 1; done

wheels: $(VENV)/.dev ## install the wheel with each extra, for each of PYTHONS that is there
	@for python in $(PYTHONS); do \
	    found=$$(command -v $$python) || { echo "$$python is not on this machine"; continue; }; \
	    echo "$$found"; \
	    NOSLIP_WHEEL_PYTHON=$$found $(BIN)/python -m pytest -q tests/test_wheel.py || exit 1; \
	done

pictures: $(VENV)/.dev ## draw docs/images anew; NAMES="blade viewer" those alone
	$(BIN)/python docs/draw.py $(NAMES)

# What an interrupted or failed build left behind may be half a file, and warns no second time: it goes.
docs: $(VENV)/.dev ## build the documentation into docs/_build/html
	@if test -e docs/_build/unfinished; then rm -rf docs/_build docs/_generated; fi
	@mkdir -p docs/_build && touch docs/_build/unfinished
	$(BIN)/sphinx-build --fail-on-warning --quiet docs docs/_build/html
	@rm docs/_build/unfinished
	@echo "docs/_build/html/index.html"

clean: ## remove everything the targets made
	rm -rf $(VENV) noslip-demo docs/_build docs/_generated dist build .mypy_cache .ruff_cache .pytest_cache .hypothesis
