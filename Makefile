# make run    fly the three-leg flight between real processes and draw it
# make test   lint, types and tests: those that are quick
# make long   the tests that take minutes, before a release: whole experiments with their verdicts,
#             an hour's flight of the whole module, links and the flying process on native code,
#             every property with more examples
# make ci     lint, types, the quick tests and a seventh of the others, in twelve minutes: what
#             continuous integration runs; which seventh follows from the commit (tests/slow_tests.py)
# make all    lint, types and all tests but the long ones: before what you push
# make bench  timings, as ratios against references of the same run
# make docs   the pages as a site: out/docs/index.html
# make pictures  the README's pictures, flown and drawn again
# make cover  the branches of supervisor and envelope that their own tests reach: all of them
# make mutate whether the tests notice small changes of the source: 500 drawn from all of it, in up
#             to an hour; docs/mutants.md lists those that they miss
#
# Each makes its own virtual environment in .venv first; nothing else on the machine is changed.

PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3.14 python3; do \
	command -v $$p >/dev/null 2>&1 && \
	$$p -c 'import sys; raise SystemExit(sys.version_info < (3, 11))' 2>/dev/null && \
	{ echo $$p; break; }; done)
VENV ?= .venv
BIN := $(VENV)/bin
# Byte code is made of what is imported, when it is: of all that comes along it takes a minute.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt
export PIP_ROOT_USER_ACTION := ignore
# In the order of tests/conftest.py, the longest first; xdist's would begin with what has the most
# cases.
WORKERS := -n 2 --dist loadgroup --no-loadscope-reorder

.DEFAULT_GOAL := help
.PHONY: help run test lint long ci all bench docs pictures cover mutate clean

help:
	@sed -n 's/^# \(make .*\)/\1/p' Makefile

run: $(VENV)/.run
	$(BIN)/tgl-soar sitl $(ARGS)

test: $(VENV)/.test lint
	$(BIN)/pytest $(WORKERS) --later none $(ARGS)

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --num-workers 2

long: $(VENV)/.test
	$(BIN)/pytest -m long $(ARGS)
	$(BIN)/pytest $(WORKERS) -m hypothesis --hypothesis-profile long

ci: $(VENV)/.test lint
	$(BIN)/pytest $(WORKERS) --later turn:$$(git rev-parse HEAD 2>/dev/null) $(ARGS)

all: $(VENV)/.test lint
	$(BIN)/pytest $(WORKERS) $(ARGS)

bench: $(VENV)/.test
	$(BIN)/python -m benchmarks $(ARGS)

docs: $(VENV)/.made pyproject.toml constraints.txt
	$(PIP) -e '.[docs]'
	$(BIN)/sphinx-build -W --keep-going -q . out/docs
	@echo out/docs/index.html

pictures: $(VENV)/.run
	$(BIN)/python tools/pictures.py

CONTROL := src/tgl_soar/control

cover: $(VENV)/.test
	$(BIN)/coverage run --branch --include='$(CONTROL)/supervisor.py,$(CONTROL)/envelope.py' \
	  -m pytest -q tests/control/test_supervisor.py tests/control/test_envelope.py
	$(BIN)/coverage report -m --fail-under=100

mutate: $(VENV)/.test
	$(BIN)/python tools/mutate.py --reach --sample 500 --least 90 --page docs/mutants.md $(ARGS)

clean:
	rm -rf $(VENV) out

$(VENV)/.made:
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed and was not found." \
	  "Install it (Debian, Ubuntu: apt install python3 python3-venv) or name one:" \
	  "make PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import sys; raise SystemExit(sys.version_info < (3, 11))' || \
	  { echo "$(PYTHON) is older than Python 3.11, which is needed."; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "$(PYTHON) lacks venv." \
	  "Install it (Debian, Ubuntu: apt install python3-venv)."; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.run: $(VENV)/.made pyproject.toml constraints.txt
	$(PIP) -e '.[figures,logs,page]'
	@touch $@

$(VENV)/.test: $(VENV)/.made pyproject.toml constraints.txt
	$(PIP) -e '.[figures,logs,page,dev,peers]'
	@touch $(VENV)/.run $@
