# Two commands do everything: `make demo` and `make test`.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
# Further extras of pyproject.toml that are installed, with commas between: make test EXTRAS=intel
EXTRAS ?=
comma  := ,
DONE   := $(VENV)/.installed$(subst $(comma),-,$(EXTRAS:%=-%))
# What is compiled is kept.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test docs install clean

demo: install
	$(BIN)/apf demo -o demo

test: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/pyrefly check
	$(BIN)/python -m pytest -n auto --dist worksteal

docs: install
	$(BIN)/python -m pip install --quiet --editable ".[docs]"
	$(BIN)/mkdocs build --strict

install: $(DONE)

$(DONE): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --no-compile --editable ".[dev$(EXTRAS:%=,%)]"
	# On all cores; pip compiles on one. Some packages carry templates that are no Python.
	$(BIN)/python -m compileall -qq -j 0 -x /tests/ $(VENV)/lib cl psfs apf || true
	touch $@

clean:
	rm -rf $(VENV) demo build
