# make reproduce   run every notebook and write the HTML report
# make test        lint, types, unit tests, notebook tests
# make lab         open JupyterLab
# make reference   write the library's reference from its docstrings
# make benchmarks  compare speed with other libraries, into data/results/speed.csv (use an idle machine)
# Each can be the first command: it sets up the environment if needed.

# The first Python 3.11 found. To use another one: make reproduce PYTHON=/path/to/python3.11
PYTHON ?= $(shell for p in python3.11 python3 python; do \
	$$p -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' >/dev/null 2>&1 && { echo $$p; break; }; done)
VENV := .venv
RUN := $(VENV)/bin/python -m

.DEFAULT_GOAL := help
.PHONY: help reproduce test lab reference benchmarks notebooks environment generated clean

help:
	@sed -n '1,6s/^# //p' Makefile

reproduce: $(VENV)/installed
	@$(RUN) hexakin.report notebooks report

test: $(VENV)/installed
	$(RUN) ruff check .
	$(RUN) ruff format --check .
	$(RUN) mypy
	$(VENV)/bin/lint-imports
	$(RUN) pytest -n 2 tests
	$(RUN) pytest -n 2 --dist loadfile --nbval notebooks

lab: $(VENV)/installed
	$(RUN) jupyter lab notebooks

# All modules are named, because pdoc leaves out modules that are not in a package's __all__. pdoc cannot evaluate the
# annotations of NamedTuples and shows them as text.
reference: $(VENV)/installed
	$(VENV)/bin/python -W "ignore:Error parsing type annotation" -W "ignore:The module specification" -m pdoc --docformat numpy --output-directory report/reference \
		$$($(VENV)/bin/python -c 'from hexakin.installation import modules; print(*modules(), "!hexakin.generated")')
	@echo "Reference: report/reference/index.html"

benchmarks: $(VENV)/installed
	$(RUN) pip install --quiet --disable-pip-version-check -r tests/benchmarks/peers.txt
	$(VENV)/bin/python tests/benchmarks

# For maintainers: run the notebooks in place, to renew their stored outputs.
notebooks: $(VENV)/installed
	$(RUN) jupyter nbconvert --to notebook --execute --inplace --ExecutePreprocessor.store_widget_state=False notebooks/*.ipynb

# For maintainers: pin the newest version of every package, with all dependencies.
environment: $(VENV)/installed
	$(RUN) uv pip compile --quiet --upgrade --universal --python-version 3.11 --all-extras --no-header pyproject.toml -o environment.txt

# For maintainers: derive the kinematics of the shipped robots again, and write the types of the public names.
generated: $(VENV)/installed
	$(RUN) hexakin.symbolic
	$(VENV)/bin/python tests/public_stub.py

clean:
	rm -rf $(VENV) report build dist

$(VENV)/installed: environment.txt pyproject.toml
	@test -n "$(PYTHON)" || { echo "hexakin needs Python 3.11, and none was found."; \
	echo "(PyBullet has ready-made packages up to Python 3.11 only; a later one has to build it, which takes"; \
	echo "about ten minutes and a C++ compiler. To try: make reproduce PYTHON=python3.12)"; \
	echo "Install Python 3.11, or name it: make reproduce PYTHON=/path/to/python3.11"; exit 1; }
	@command -v "$(PYTHON)" >/dev/null || { echo "PYTHON=$(PYTHON): no such program."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	echo "$(PYTHON) is older than Python 3.11, which hexakin needs."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info >= (3, 12))' || \
	echo "$(PYTHON) is newer than 3.11: PyBullet will be built from source (about ten minutes, needs a C++ compiler)."
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { \
	echo "$(PYTHON) cannot make virtual environments; on Debian and Ubuntu: apt-get install python3-venv"; exit 1; }
	@echo "Setting up $(VENV) with $(PYTHON); the first time takes a few minutes."
	@$(PYTHON) -m venv $(VENV)
	@$(RUN) pip install --quiet --disable-pip-version-check -r environment.txt
	@$(RUN) pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@
