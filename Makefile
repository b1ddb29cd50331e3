# make demo: train and evaluate small controllers.   make test: run the tests.   Both set up what they need.
PYTHON ?= python3
MINUTES ?= 3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
STAMP := $(VENV)/.installed
LOWEST := .venv-lowest
WITH ?= --torch-backend cpu
EXTRAS := train,search,cluster,cad,onnx,data,view,rig,parquet,camera,docs,dev,benchmarks
VERIFIED := install --require-hashes --only-binary :all:
TORCH ?= $(shell sed -n 's/^torch==\([0-9.]*\) .*/\1/p' constraints.txt)

.PHONY: help setup demo test test-slow test-lowest wheels sbom fuzz fuzz-long speed campaign results docs lint lock clean
.DEFAULT_GOAL := help

help:
	@echo "make demo      train two small controllers, evaluate them, write a report (a few minutes)"
	@echo "make test      run the tests; make test-slow runs the ones left out"
	@echo "make test-lowest  the same with the lowest releases that pyproject.toml admits (TESTS=tests/rj_gym: some)"
	@echo "make wheels    build the wheel and use it from an empty folder (PYTHONS=\"python3.12 python3.14\": with these)"
	@echo "make sbom      the same, which leaves the wheel and its bill of materials (CycloneDX) in dist/"
	@echo "make fuzz      the standing attack, three minutes with new seeds (MINUTES=1: one); docs/reliability.md"
	@echo "make fuzz-long the same until its goals are reached (one to two hours; again: goes on)"
	@echo "make speed     measure everything and rewrite docs/speed.md (some minutes, nothing else running)"
	@echo "make campaign  train the runs of docs/results.md into runs/instrument (some hours; again: goes on)"
	@echo "make results   score them and rewrite docs/results.md (some minutes)"
	@echo "make docs      build the documentation site: site/index.html, which opens from disk"
	@echo "make lint      style, types, import layers, names and prose"
	@echo "make lock      renew constraints.txt: versions and hashes of what setup installs (UPGRADE=1: the newest)"
	@echo "make setup     virtual environment in $(VENV); the others call it"
	@echo "make clean     remove the environment, caches and builds (results in runs/ stay)"
	@echo "Another Python: make demo PYTHON=python3.12"

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "Python 3.11 or newer is needed; $(PYTHON) is: $$($(PYTHON) --version 2>&1 | head -n 1)."; \
	  echo "Name another one, for example: make $(MAKECMDGOALS) PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { \
	  echo "$(PYTHON) lacks the venv module. Debian and Ubuntu: apt install python3-venv"; exit 1; }
	@echo "==> Setting up $(VENV) (once; about 2 GB, a few minutes)"
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	@sed -n '/^torch==/,/[^\\]$$/p' constraints.txt > $(VENV)/torch.txt
	@$(PIP) $(VERIFIED) --no-deps -r $(VENV)/torch.txt 2>$(VENV)/torch.log || { \
	  grep -q "No matching distribution" $(VENV)/torch.log || { cat $(VENV)/torch.log; exit 1; }; \
	  echo "    the CPU build of torch is not in pip's index; uv fetches it from PyTorch's own"; \
	  $(PIP) $(VERIFIED) -r .ci/uv.txt && \
	  $(BIN)/uv pip $(VERIFIED) --quiet --python $(BIN)/python --torch-backend cpu --no-deps -r $(VENV)/torch.txt; }
	@$(PIP) $(VERIFIED) -r constraints.txt
	@$(PIP) install --no-deps --no-build-isolation -e .
	@touch $@

demo: setup
	@echo "==> Training two small controllers: by the derivatives of the simulator, and beside it by PPO of Stable-Baselines3"
	@mkdir -p runs; \
	  $(BIN)/rj train --config configs/train/demo.yaml --run-dir runs/ppo --force >runs/ppo.txt 2>&1 & ppo=$$!; \
	  $(BIN)/rj train --config configs/train/apg_rolling_joint.yaml --run-dir runs/demo --force; status=$$?; \
	  wait $$ppo || status=$$?; cat runs/ppo.txt; exit $$status
	@echo "==> Evaluating both under random loads"
	@$(BIN)/rj evaluate runs/demo --beside runs/ppo

test: setup
	@echo "==> Running the tests"
	@$(BIN)/python -m pytest -n 2 --durations=25

test-slow: setup
	@echo "==> Running the slow tests"
	@$(BIN)/python -m pytest -n 2 --dist worksteal -m slow --durations=25

# Old releases warn of what newer ones of their own dependencies will change: that is not an error here.
test-lowest: setup
	@echo "==> Installing the lowest releases that pyproject.toml admits"
	@$(PIP) $(VERIFIED) -r .ci/uv.txt
	@$(BIN)/uv venv --quiet --clear --python $(BIN)/python $(LOWEST)
	@$(BIN)/uv pip install --quiet --python $(LOWEST) --resolution lowest-direct $(WITH) -e ".[$(EXTRAS)]"
	@echo "==> Running the tests"
	@$(LOWEST)/bin/python -m pytest -n 2 -W default::DeprecationWarning -W default::PendingDeprecationWarning $(TESTS)

wheels: setup
	@echo "==> Building the wheel and using it"
	@$(BIN)/python .ci/check_wheel.py $(PYTHONS)

sbom: setup
	@echo "==> Building the wheel, describing and using it"
	@$(BIN)/python .ci/check_wheel.py --out dist $(PYTHONS)

fuzz: setup
	@echo "==> Attacking"
	@$(BIN)/python -m tests.attack --minutes $(MINUTES) $(if $(PARTS),--parts $(PARTS))

fuzz-long: setup
	@echo "==> Attacking until every goal is reached"
	@$(BIN)/python -m tests.attack --goals --minutes 150 --out runs/attack.json

speed: setup
	@echo "==> Measuring"
	@$(BIN)/python benchmarks/speed.py

campaign: setup
	@echo "==> Training the runs of the results page"
	@$(BIN)/rj campaign configs/campaign/instrument.yaml --out runs/instrument

results: setup
	@echo "==> Scoring them and rewriting docs/results.md"
	@$(BIN)/rj results runs/instrument --per-point 100 --shipped

docs: setup
	@echo "==> Writing the pages"
	@$(BIN)/python docs/_pages
	@echo "==> Building the site"
	@$(BIN)/zensical build --strict
	@echo "==> Open site/index.html"

lint: setup
	@echo "==> Style"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@echo "==> Types"
	@$(BIN)/mypy
	@echo "==> Import layers"
	@$(BIN)/lint-imports
	@echo "==> Names and prose"
	@$(BIN)/python .ci/prose.py

lock: setup
	@echo "==> Renewing versions and hashes"
	@$(PIP) $(VERIFIED) -r .ci/uv.txt
	@$(BIN)/python .ci/lock.py --extras $(EXTRAS) --torch $(TORCH) --with-cpu="$(WITH)" $(if $(UPGRADE),--upgrade)

clean:
	@echo "==> Removing the environment, caches and builds"
	@rm -rf $(VENV) $(LOWEST) .cache build dist site *.egg-info .pytest_cache .ruff_cache .mypy_cache .import_linter_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
