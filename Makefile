# A fresh clone needs Python 3.11 to 3.13 with pip, and make:
#   make demo    a robot imitates; results in runs/demo
#   make test    the whole test suite
# Everything goes into .venv, installed once from constraints.txt; `make help` lists the rest.

PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null && echo $$p && break; done)
VENV ?= .venv
BIN := $(VENV)/bin
IMITOR := $(BIN)/imitor
PRESETS := $(wildcard pipelines/*.yaml)
PIP := $(BIN)/python -m pip --disable-pip-version-check
ARGS ?=

.DEFAULT_GOAL := help
.PHONY: help install demo test check format lint types generate generated presets fast docs picture lock clean

help:  ## Say what can be made.
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

install: $(VENV)/.installed  ## Create .venv with imitor and everything it needs.

demo: $(VENV)/.installed  ## Run the built-in demo; ARGS='--robot talos' changes it.
	$(IMITOR) run demo $(ARGS)

test: $(VENV)/.installed  ## Run the whole test suite, two tests at a time; ARGS='-k guard' chooses.
	$(BIN)/python -m pytest -n 2 $(ARGS)

check: format lint types generated presets fast  ## All that a change must pass before it is handed in.

format: $(VENV)/.installed
	$(BIN)/ruff format --check .

lint: $(VENV)/.installed
	$(BIN)/ruff check .

types: $(VENV)/.installed
	$(BIN)/mypy
	$(BIN)/mypy tests

generate: $(VENV)/.installed  ## Write the generated pages, tables and the JSON schema anew.
	IMITOR_PLUGINS= $(IMITOR) schema --out pipelines/imitor.schema.json
	IMITOR_PLUGINS= $(BIN)/python docs/_generate.py

generated: $(VENV)/.installed
	IMITOR_PLUGINS= $(BIN)/python docs/_generate.py --check

presets: $(VENV)/.installed
	$(IMITOR) check $(PRESETS)

fast: $(VENV)/.installed
	$(BIN)/python -m pytest -n 2 -m 'not slow' $(ARGS)

docs: $(VENV)/.documented  ## Build the documentation into docs/_build; warnings are errors.
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build/html

picture: $(VENV)/.installed  ## Make the picture of the README anew.
	$(IMITOR) run demo --quiet --out build/picture
	mkdir -p docs/img
	cp build/picture/video.png docs/img/demo.png

lock:  ## Resolve all dependencies anew and write constraints.txt.
	$(call need_python)
	rm -rf build/lock
	$(PYTHON) -m venv build/lock
	build/lock/bin/python -m pip install --quiet -e '.[dev,docs,video,c3d]'
	{ sed '/^[^#]/,$$d' constraints.txt; build/lock/bin/python -m pip freeze --exclude imitor --exclude-editable; } > build/constraints.txt
	mv build/constraints.txt constraints.txt
	rm -rf build/lock

clean:  ## Remove what was made, but not runs/.
	rm -rf $(VENV) build docs/_build .mypy_cache .ruff_cache .pytest_cache .hypothesis

define need_python
@$(if $(PYTHON),$(PYTHON) -c 'import sys; v = sys.version.split()[0]; \
	sys.exit(0 if (3, 11) <= sys.version_info < (3, 14) else \
	"imitor needs Python 3.11, 3.12 or 3.13, and $(PYTHON) is %s. Name another: make PYTHON=/path/to/python3.12" % v)',\
	echo 'imitor needs Python 3.11, 3.12 or 3.13, and none is on the path. Name one: make PYTHON=/path/to/python3.12' >&2; exit 2)
endef

$(VENV)/.installed: pyproject.toml constraints.txt
	$(call need_python)
	$(PYTHON) -m venv $(VENV)
	$(PIP) install --quiet -c constraints.txt -e '.[dev]'
	@touch $@

$(VENV)/.documented: $(VENV)/.installed
	$(PIP) install --quiet -c constraints.txt -e '.[docs]'
	@touch $@
