# make report   set up, compare all engines, write report/report.html
# make test     set up, run the test suites of the core and of the audit of the paper
# make test-all set up, run the test suites of all distributions here (not of the plug-ins: they need environments),
#               with three times as many random machines and the same evidence again on further machines
# make all      set up all distributions here: core, paper, environments, importers, toolkit
# make quick    the fast tier: no engine simulates (under a minute)
# make plugins  the engines of others: an environment each, their tests, plugins/results/*.json
# make results  the built-in engines on all problems: docs/results/*.json (an hour or two; it resumes)
# make importers  what reads MJCF: an environment each, importers/*/results.json (half an hour)
# make known-models  the planar models of dm_control and Gymnasium, audited: docs/known-models.* (five minutes);
#               KNOWN_MODELS="--dm-control FOLDER --version TEXT" where dm_control cannot be installed
# make mujoco3  the MuJoCo adapter and the files on the least MuJoCo that is supported
# make docs     the documentation as a site, in site/
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
SOURCES := $(shell git ls-files '*.py' 'models/mjcf' 'comparisons/data' '*.json' '*.j2' '*.js' '*.css' 2>/dev/null) pyproject.toml
OPEN   ?= $(shell command -v xdg-open || command -v open || echo true)

PLUGINS ?= $(filter-out toolkit,$(patsubst plugins/%/pyproject.toml,%,$(wildcard plugins/*/pyproject.toml)))
SATELLITES := ./environments ./importers ./plugins/toolkit

.PHONY: report test test-all all quick lint types generated docs benchmark plugins results importers known-models mujoco3 clean

# Wheels are installed, not the checkout: that proves that they are complete, and is what type checkers resolve.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
$(VENV)/installed: $(SOURCES) constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) --constraint constraints.txt ".[test,lint]" ./paper
	$(PIP) --force-reinstall --no-deps . ./paper
	$(BIN)/python -c "import trebucheck.reference.kernel"  # compiled here, and not by each worker of the tests
	rm -rf build *.egg-info paper/build paper/*.egg-info
	touch $@

$(VENV)/satellites: $(VENV)/installed
	$(PIP) --constraint constraints.txt $(SATELLITES)
	$(PIP) --force-reinstall --no-deps $(SATELLITES)
	rm -rf $(SATELLITES:%=%/build) $(SATELLITES:%=%/*.egg-info)
	touch $@

all: $(VENV)/satellites

report: $(VENV)/installed
	$(BIN)/trebucheck compare --out report || test $$? -eq 1  # 1: some run disagrees, as stock presets do; the report says which
	@test -n "$$CI$$SSH_CONNECTION" || $(OPEN) report/report.html >/dev/null 2>&1 || true

# Plug-ins by name: of a distribution that announces one, pytest would rewrite the assertions of every module, and
# without bytecode of tests anew in each process.
PLUG_INS := --disable-plugin-autoload -p xdist -p _hypothesis_pytestplugin -p trebucheck.conformance.plugin
PYTEST := $(BIN)/python -m pytest $(PLUG_INS) -n 2 --dist loadfile --no-loadscope-reorder
# One thread of BLAS a process: matrices are small, and threads that wait for work take a core each.
# What an assertion compared is told of those that failed, in a run of them alone: to have all tells costs half of
# the collection.
test: $(VENV)/installed
	HYPOTHESIS_PROFILE=few OPENBLAS_NUM_THREADS=1 $(PYTEST) -m "not again" --assert plain || \
		{ HYPOTHESIS_PROFILE=few $(BIN)/python -m pytest -m "not again" --last-failed --last-failed-no-failures none; false; }

test-all: $(VENV)/satellites
	$(PYTEST) tests paper/tests environments/tests importers/tests plugins/toolkit/tests

quick: $(VENV)/installed
	$(BIN)/python -m pytest tests/unit tests/verification -m "not slow and not again" -n 2

lint: $(VENV)/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/satellites
	$(BIN)/pyright --pythonpath $(BIN)/python

generated: $(VENV)/satellites
	$(BIN)/python docs/generate.py
	$(BIN)/python importers/generate.py
	$(BIN)/python paper/generate.py

known-models: $(VENV)/satellites
	-$(PIP) --no-deps "$$(grep dm_control== importers/dm_control/requirements.txt)"  # its files alone
	$(BIN)/python -m trebucheck_environments.known_models docs $(KNOWN_MODELS)

docs: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt ".[docs]"
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

benchmark: $(VENV)/installed
	$(BIN)/python benchmarks/launch.py

# Kept with results: the last commit of the code that they follow from, and a mark where files differ from it.
CODE := models reference engines comparisons conformance constraints.txt 'plugins/*/trebucheck_*'
COMMIT = $(shell git log -1 --abbrev=8 --format=%h -- $(CODE))$(shell git diff --quiet HEAD -- $(CODE) || echo +changes)

BUDGET ?= 120
DIAGNOSE ?=
plugins:
	$(PYTHON) plugins/run.py . --budget $(BUDGET) --commit "$(COMMIT)" $(DIAGNOSE) $(PLUGINS)

results: $(VENV)/satellites
	COMMIT="$(COMMIT)" $(BIN)/python docs/generate.py results

importers: $(VENV)/satellites
	$(PYTHON) importers/run.py $(abspath $(BIN)/trebucheck) $(IMPORTERS); \
		code=$$?; $(BIN)/python importers/generate.py importers && exit $$code

LEAST_MUJOCO := 3.3.5
mujoco3:
	test -x .mujoco3/bin/python || $(PYTHON) -m venv .mujoco3
	grep -v '^mujoco' constraints.txt > .mujoco3/constraints.txt
	.mujoco3/bin/python -m pip install --quiet --disable-pip-version-check --constraint .mujoco3/constraints.txt ".[test]" mujoco==$(LEAST_MUJOCO)
	.mujoco3/bin/python -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps .
	.mujoco3/bin/python -m pytest -n 2 tests/agreement/test_mujoco*.py tests/agreement/test_inspection.py \
		tests/agreement/test_zoo.py tests/agreement/test_mjcf_models.py tests/unit/test_mjcf_writer.py

clean:
	rm -rf $(VENV) .plugins .results .importers .mujoco3 build report site *.egg-info
