# The living edition: `make book` builds it, `make test` tests it, `make help` lists the rest.

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help book smoke pdf films test test-slow lint setup serve clean

VENV := .venv
RUN := $(VENV)/bin/python -m
PORT ?= 8000
# By default JupyterLab skips the {eval} words of cells that nobody has scrolled to.
LAB := etc/jupyter/labconfig/default_setting_overrides.d/thesis_lib.json
# Two processes: one builds and reads the book while the other does the rest.
PYTEST ?= pytest -n 2 --dist loadfile

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

book: setup  ## execute what changed and build the book into _build/html
	@$(RUN) thesis_lib.cli book

smoke: setup  ## the same at the smoke budget, as the tests do, into _build/html-smoke
	@$(RUN) thesis_lib.cli book --budget smoke

pdf: book  ## the built book as one file, _build/book.pdf (needs Chromium)
	@$(RUN) thesis_lib.book.pdf

films: setup  ## draw the films of book/films.toml again, from the committed policies
	@$(RUN) thesis_lib.book.films

test: setup  ## run all tests but the slow ones
	@$(RUN) $(PYTEST) -m "not slow" tests

test-slow: setup  ## run the slow tests
	@$(RUN) $(PYTEST) -m slow tests

lint: setup  ## check style, formatting, types and workflows
	@$(RUN) ruff check .
	@$(RUN) ruff format --check .
	@$(RUN) mypy
	@$(RUN) check_jsonschema --quiet --builtin-schema vendor.github-workflows .github/workflows/*.yml

# The environment is good while the stamp names this folder, pyproject.toml and constraints.txt
# as they are; a checkout that only changed their dates installs nothing again.
setup:  ## create .venv and install the pinned dependencies
	@set -euo pipefail; \
	state="$$(pwd) $$(cksum pyproject.toml constraints.txt)"; \
	if [ "$$(cat $(VENV)/.installed 2>/dev/null)" = "$$state" ]; then exit 0; fi; \
	is311='import sys; sys.exit(sys.version_info[:2] != (3, 11))'; \
	python=; \
	for candidate in $(PYTHON) python3.11 python3 python; do \
	    if "$$candidate" -c "$$is311" 2>/dev/null; then python=$$candidate; break; fi; \
	done; \
	if [ -z "$$python" ]; then \
	    found=$$(python3 --version 2>/dev/null || echo "no Python"); \
	    echo "This book needs Python 3.11, but found $$found: install it, or name it with" \
	         "'make setup PYTHON=/path/to/python3.11'." >&2; \
	    exit 1; \
	fi; \
	rm -f $(VENV)/.installed; \
	$(VENV)/bin/python -c "import pip; $$is311" 2>/dev/null || "$$python" -m venv --clear $(VENV); \
	echo "Installing the pinned dependencies into $(VENV) (a few minutes the first time) ..."; \
	export PIP_DISABLE_PIP_VERSION_CHECK=1; \
	$(RUN) pip install --quiet -c constraints.txt pip; \
	$(RUN) pip install --quiet \
	    -c constraints.txt -e '.[book,test,lab]'; \
	echo "$$state" > $(VENV)/.installed; \
	echo "Done."
	@mkdir -p $(VENV)/$(dir $(LAB)) && cp book/jupyterlab.json $(VENV)/$(LAB)

serve:  ## serve the built book at http://localhost:8000 (or PORT=...)
	@test -f _build/html/index.html || { echo "There is no book yet: run 'make book' first." >&2; exit 1; }
	@echo "Serving the book at http://localhost:$(PORT)/ (Ctrl-C stops it)."
	@$(RUN) http.server --bind 127.0.0.1 --directory _build/html $(PORT)

clean:  ## remove everything that was built; .venv and runs (_build/runs) stay
	test ! -d _build || find _build -mindepth 1 -maxdepth 1 ! -name runs -exec rm -rf {} +
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find thesis_lib tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +
