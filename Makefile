# Every verb sets up what it needs by itself: a virtual environment and the pinned dependencies.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
WORKERS := --numprocesses auto --maxprocesses 4
TRAININGS ?= 2

export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

.PHONY: bench bench-smoke calibrate clean gate lint maps perf report reproduce robustness setup test test-slow train

bench: $(READY)          ## Run the paper suite, then write every table and figure
	@$(BIN)/explore-bench run paper; status=$$?; $(BIN)/explore-bench report && exit $$status

bench-smoke: $(READY)    ## The same in under a minute, into results/smoke
	@$(BIN)/explore-bench run smoke --results results/smoke; status=$$?; \
	  $(BIN)/explore-bench report --results results/smoke && exit $$status

robustness: $(READY)     ## Every strategy under other noise, ranges, densities and occlusion, into results/robustness
	@$(BIN)/explore-bench run robustness --results results/robustness; status=$$?; \
	  $(BIN)/explore-bench report --results results/robustness && exit $$status

gate: $(READY)           ## Is a metric worse than results/reference tolerates? A minute, into results/gate
	@$(BIN)/explore-bench run smoke -s nearest -s entropy -s uncertainty --trials 250 --results results/gate; \
	  $(BIN)/explore-bench gate --results results/gate

maps: $(READY)           ## The compared methods in the maps of the gallery, into results/maps
	@$(BIN)/explore-bench run maps --results results/maps; status=$$?; \
	  $(BIN)/explore-bench report --results results/maps && exit $$status

report: $(READY)         ## Tables and figures from stored records
	$(BIN)/explore-bench report

reproduce: $(READY)      ## Run the trials of results/trials.csv anew and compare every value, into results/reproduced
	$(BIN)/python docs/studies/reproduce.py

perf: $(READY)           ## Where a step's time goes
	$(BIN)/explore-bench perf

test: $(READY)           ## The tests
	$(BIN)/pytest -m "not slow" $(WORKERS)

test-slow: $(READY)      ## The tests that take minutes
	$(BIN)/pytest -m slow $(WORKERS)

lint: $(READY)           ## Style, types, and pages that match the results
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python docs/fill.py --check

calibrate: $(READY)      ## The studies behind the constants that the paper leaves out
	$(BIN)/python docs/studies/calibration.py
	$(BIN)/python docs/studies/uncertainty_weight.py
	$(BIN)/python docs/studies/clairvoyant_beam.py

train: $(READY)          ## Train every shipped weight anew, into results/training; goes on where it stopped
	@for card in baselines/weights/*.json; do echo $$(basename $$card .json); done | \
	  xargs -P $(TRAININGS) -I{} sh -c 'name=$${0%-*}; \
	    $(BIN)/explore-bench train "$$name" --seed "$${0##*-}" --resume || exit 255' {}

setup: $(READY)          ## Only set up

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test,lint]'
	@touch $(READY)

clean:                   ## Remove the environment and what tools left; results stay
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
