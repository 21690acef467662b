# Every verb sets up what it needs by itself: a virtual environment and the pinned dependencies.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
WORKERS := --numprocesses logical --maxprocesses 4 --dist worksteal
TRAININGS ?= 2

# Runs a suite (1) into a folder (2) and reports it, also where trials failed; ends with the status of the run.
suite = ($(BIN)/explore-bench run $(1) --results $(2); status=$$?; \
	  $(BIN)/explore-bench report --results $(2) && exit $$status)

# Runs what the gate compares, in both kinds of world.
gated = ($(BIN)/explore-bench run smoke -s nearest -s entropy -s uncertainty -s next-best-view --trials 250 \
	    --results results/gate; status=$$?; \
	  $(BIN)/explore-bench run smoke --scenario stage -s nearest --trials 50 --results results/gate/stage && \
	    exit $$status)

export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

.PHONY: accept bench bench-smoke calibrate clean confirm docs field gate lint maps mutate mutate-kernels perf plans \
  report reproduce robustness setup stage test test-slow torture train

bench: $(READY)          ## Run the paper suite, then write every table and figure; Figure 16 into results/figure16
	@$(call suite,paper,results); status=$$?; $(call suite,figure16,results/figure16) && exit $$status

bench-smoke: $(READY)    ## The paper's suite in small, in under a minute, into results/smoke
	@$(call suite,smoke,results/smoke)

robustness: $(READY)     ## Every strategy under other noise, ranges, densities and occlusion, into results/robustness
	@$(call suite,robustness,results/robustness)

stage: $(READY)          ## The compared methods in lidar worlds at two ranges, into results/stage; half an hour
	@$(call suite,stage,results/stage)

plans: $(READY)          ## Five methods in drawn floor plans with a lidar, into results/plans; half an hour
	@$(call suite,plans,results/plans)

field: $(READY)          ## Rules of others in the paper's and in lidar worlds, into results/field and results/field-stage
	@$(call suite,field,results/field); status=$$?; $(call suite,field-stage,results/field-stage) && exit $$status

gate: $(READY)           ## Is a metric worse than results/reference tolerates? Two minutes, into results/gate
	@$(gated); \
	  $(BIN)/explore-bench gate --results results/gate; status=$$?; \
	  $(BIN)/explore-bench gate --results results/gate/stage --reference results/reference/stage && exit $$status

accept: $(READY)         ## Make what the present code does the new reference of the gate: make accept REASON='why'
	@$(gated) && \
	  $(BIN)/explore-bench gate --results results/gate --accept --reason "$(REASON)" && \
	  $(BIN)/explore-bench gate --results results/gate/stage --reference results/reference/stage --accept \
	    --reason "$(REASON)"

maps: $(READY)           ## The compared methods in the maps of the gallery, into results/maps
	@$(call suite,maps,results/maps)

confirm: $(READY)        ## Ours against all others in worlds of a seed used once, as results/confirmation declares; hours
	$(BIN)/python docs/studies/confirm.py

report: $(READY)         ## Tables and figures from stored records
	$(BIN)/explore-bench report

reproduce: $(READY)      ## Run the trials of results/trials.csv anew and compare every value, into results/reproduced
	$(BIN)/python docs/studies/reproduce.py

torture: $(READY)        ## Kills, full disks, wounded files, misbehaving plugins: is anything lost or harmed? An hour
	$(BIN)/python tests/torture.py

mutate: $(READY)         ## Which changes of metrics, statistics, claims and gate no test notices; a quarter of an hour
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[mutation]'
	$(BIN)/mutmut run
	$(BIN)/mutmut results

mutate-kernels: $(READY) ## Which of a sample of changes of compiled functions no test notices; an hour
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[mutation]'
	$(BIN)/python tests/mutate_kernels.py

perf: $(READY)           ## Where a step's time goes
	$(BIN)/explore-bench perf

test: $(READY)           ## The tests
	$(BIN)/pytest -m "not slow" $(WORKERS)

test-slow: $(READY)      ## The tests that take minutes
	$(BIN)/pytest -m slow $(WORKERS)

lint: $(READY)           ## Style, types, pages that match the results, and a site without a broken link
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python docs/fill.py --check
	$(BIN)/mkdocs build --strict --quiet

docs: $(READY)           ## The documentation as a site, into site/
	$(BIN)/mkdocs build --strict

calibrate: $(READY)      ## The studies behind the constants that the paper leaves out
	$(BIN)/python docs/studies/calibration.py
	$(BIN)/python docs/studies/path_weights.py
	$(BIN)/python docs/studies/tours.py

train: $(READY)          ## Train every shipped weight anew, into results/training; goes on where it stopped
	@for card in baselines/weights/*.json; do echo $$(basename $$card .json); done | \
	  xargs -P $(TRAININGS) -I{} sh -c 'name=$${0%-*}; \
	    $(BIN)/explore-bench train "$$name" --seed "$${0##*-}" --resume || exit 255' {}

setup: $(READY)          ## Only set up
	@echo "Ready: . $(VENV)/bin/activate puts explore-bench on the path."

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test,lint,docs]'
	@touch $(READY)

clean:                   ## Remove the environment and what tools left; results stay
	rm -rf $(VENV) build mutants site *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
