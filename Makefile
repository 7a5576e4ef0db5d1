# make demo    all four loops on shipped data, ends at out/demo/index.html; nothing else installed than python3 and make
# make test    what a change is tried on: 8 minutes of processor time; the tests with a ROS master keep time and mostly
#              wait, so the others give way to them meanwhile; each of them up to three times, as a busy machine may not let it
# make test-rest   what make test leaves out: slow searches, the pages of the docs, broken files, more of ROS, other Pythons
# make test-pythons    install, demo, a plan and a gap search with each of Python 3.10 to 3.13 that is here; 3 minutes
# make lint    style, types, import direction, and the budget of the house
# make docs    the pages as HTML in site/, warnings are errors; writes what is made from the code into docs/reference
# make docs-serve   the same pages on http://127.0.0.1:8000, with search

# PyBullet has wheels up to Python 3.11, so that one is preferred; any Python from 3.10 on will do.
PYTHON ?= $(shell for p in python3.11 python3.10 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null && { echo $$p; break; }; done)
VENV := .venv
BIN := $(VENV)/bin

# Another apt-get may be at work, such as the unattended upgrades of a new machine: wait for it, ten minutes at most. The
# time limit of apt is for the lock of packages; that of the lists is asked for again and again.
APT := DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=600
APT_UPDATE := { for i in $$(seq 120); do case "$$($(APT) update -qq 2>&1)" in *"get lock"*) sleep 5;; *) break;; esac; done; }

# Debian 12 has ROS 1; Ubuntu 20.04 has it as Noetic under other names.
ROS_PACKAGES := python3-rospy python3-rosbag python3-rosmaster python3-roslaunch \
	python3-sensor-msgs python3-trajectory-msgs python3-std-msgs

.PHONY: demo test test-rest test-pythons ros screen lint docs docs-serve clean

demo: $(VENV)/.ready
	$(BIN)/dynid demo

# Those with a ROS master run one by one, $(1) of them; the others beside them.
define run_tests
@$(BIN)/python -m pytest -ra -m "ros and $(1)" --reruns 2 tests/ros >$(VENV)/ros.txt 2>&1 & ros=$$!; \
nice -n 19 $(BIN)/python -m pytest -n 2 --dist worksteal -m "not ros and $(1)"; status=$$?; \
wait $$ros || status=1; cat $(VENV)/ros.txt; exit $$status
endef

test: $(VENV)/.ready-test ros screen
	$(call run_tests,not slow)

# Each step of tests/pythons.py has a time limit of its own, and all of them together have this one.
test-rest: $(VENV)/.ready-test ros screen
	$(call run_tests,slow)
	timeout 2400 $(MAKE) test-pythons

# The tests of recording start a ROS master; where we may not install it they are skipped, with CI=true they fail.
ros:
	@PYTHONPATH=src $(BIN)/python -c 'import sys; from dynid.drivers.ros import missing_modules as m; sys.exit(bool(m()))' \
		&& command -v rosmaster >/dev/null || { \
		test "$$(id -u)" = 0 && command -v apt-get >/dev/null && echo "installing ROS 1 with apt" && \
		$(APT_UPDATE) && $(APT) install -y -qq --no-install-recommends \
			$(ROS_PACKAGES) >/dev/null; } || echo "no ROS 1 here: the tests of recording are left out" >&2

# The window of the preview is tested on a virtual screen.
screen:
	@command -v xvfb-run >/dev/null || { \
		test "$$(id -u)" = 0 && command -v apt-get >/dev/null && echo "installing a virtual screen with apt" && \
		$(APT_UPDATE) && $(APT) install -y -qq --no-install-recommends \
			xvfb xauth libgl1 libgl1-mesa-dri >/dev/null; } || echo "no virtual screen: its test is left out" >&2

test-pythons: $(BIN)/python
	$(BIN)/python tests/pythons.py

lint: $(VENV)/.ready-lint
	$(BIN)/ruff format --check .ci src tests benchmarks trajectories
	$(BIN)/ruff check .ci src tests benchmarks
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/python .ci/budget.py

docs: $(VENV)/.ready-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

docs-serve: $(VENV)/.ready-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs serve

$(VENV)/.ready: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	@touch $@

$(VENV)/.ready-%: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[$*]'
	@touch $@

# Debian's python3 comes without ensurepip: virtualenv stands in, or apt brings it when we may use it.
$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "dynid needs Python 3.10 or newer: make PYTHON=/path/to/python3" >&2; exit 1; }
	@echo "making $(VENV) with $(PYTHON)"
	@rm -rf $(VENV); $(PYTHON) -m venv $(VENV) 2>/dev/null && $@ -m pip --version >/dev/null 2>&1 || { \
		rm -rf $(VENV); virtualenv --quiet --python $(PYTHON) $(VENV) 2>/dev/null; } || { \
		test "$$(id -u)" = 0 && $(APT_UPDATE) && $(APT) install -y -qq python3-venv >/dev/null && \
		rm -rf $(VENV) && $(PYTHON) -m venv $(VENV); } || { \
		rm -rf $(VENV); echo "no virtual environment: install python3-venv or virtualenv" >&2; exit 1; }

clean:
	rm -rf $(VENV) out site
