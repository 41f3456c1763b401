# make reproduce   run every notebook and write the HTML report
# make test        lint, types, unit tests, notebook tests
# make test-wheel  install the built wheel into a fresh environment of Python 3.13 and use it there
# make lab         open JupyterLab
# make reference   write the library's reference from its docstrings
# make benchmarks  compare speed with other libraries, into data/results/speed.csv (use an idle machine)
# Each can be the first command: it sets up the environment if needed.

# The first Python of 3.11 to 3.14 that runs (a name on the PATH may be a launcher of a Python that is not installed).
# To use another one: make reproduce PYTHON=/path/to/python3.12
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3.14 python3 python; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' >/dev/null 2>&1 && \
	{ echo $$p; break; }; done)
VENV := .venv
RUN := $(VENV)/bin/python -m
# What environment.txt has besides the library: the extras that `make reproduce` and `make test` need.
EXTRAS := notebooks reference tests build mujoco

.DEFAULT_GOAL := help
.PHONY: help reproduce test test-wheel lab reference benchmarks notebooks environment generated clean

help:
	@sed -n '1,7s/^# //p' Makefile

reproduce: $(VENV)/installed
	@$(RUN) hexakin.report notebooks report

test: $(VENV)/installed
	$(RUN) ruff check .
	$(RUN) ruff format --check .
	$(RUN) mypy
	$(VENV)/bin/lint-imports
	$(RUN) pytest -n 2 tests
	$(RUN) pytest -n 2 --dist loadfile --nbval notebooks

test-wheel: $(VENV)/installed
	$(VENV)/bin/python tests/wheel
	$(VENV)/bin/python tests/wheel/pybullet_builds.py

lab: $(VENV)/installed
	$(RUN) pip install --quiet --disable-pip-version-check -r notebooks/lab.txt
	$(RUN) jupyter lab notebooks

reference: $(VENV)/installed
	$(VENV)/bin/python tests/reference.py report/reference
	@echo "Reference: report/reference/index.html"

benchmarks: $(VENV)/installed
	$(RUN) pip install --quiet --disable-pip-version-check -r tests/benchmarks/peers.txt
	$(VENV)/bin/python tests/benchmarks

# For maintainers: run the notebooks in place, to renew their stored outputs.
notebooks: $(VENV)/installed
	$(RUN) jupyter nbconvert --to notebook --execute --inplace --ExecutePreprocessor.store_widget_state=False notebooks/*.ipynb

# For maintainers: pin the newest version of every package, with all dependencies, for all Pythons and platforms.
environment: $(VENV)/installed
	$(RUN) uv pip compile --quiet --upgrade --universal --python-version 3.11 $(EXTRAS:%=--extra %) --no-header pyproject.toml -o environment.txt

# For maintainers: derive the kinematics of the shipped robots again, and write the types of the public names.
generated: $(VENV)/installed
	$(RUN) hexakin.symbolic
	$(VENV)/bin/python tests/public_stub.py

clean:
	rm -rf $(VENV) report build dist

$(VENV)/installed: environment.txt pyproject.toml
	@test -n "$(PYTHON)" || { echo "hexakin needs Python 3.11, 3.12, 3.13 or 3.14, and none was found."; \
	echo "Install one, or name it: make reproduce PYTHON=/path/to/python3.12"; exit 1; }
	@command -v "$(PYTHON)" >/dev/null || { echo "PYTHON=$(PYTHON): no such program."; exit 1; }
	@$(PYTHON) -c '' || { echo "PYTHON=$(PYTHON) does not run."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' || { \
	echo "$(PYTHON) is not Python 3.11, 3.12, 3.13 or 3.14, which hexakin needs."; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { \
	echo "$(PYTHON) cannot make virtual environments; on Debian and Ubuntu: apt-get install python3-venv"; exit 1; }
	@echo "Setting up $(VENV) with $(PYTHON); the first time takes a few minutes."
	@$(PYTHON) -m venv $(VENV)
	@$(RUN) pip install --quiet --disable-pip-version-check -r environment.txt
	@$(RUN) pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@
