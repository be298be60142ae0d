# The Fleet Computer: `make demo` flies the example, `make test` passes the tests. `make help` lists the rest.
SHELL := /bin/sh
PYTHON ?= python3
VENV ?= .venv
OUT ?= out/demo
BIN := $(VENV)/bin
# Progress bars for people, silence for logs.
PIP = [ -t 1 ] || quiet=--quiet; $(BIN)/python -m pip --disable-pip-version-check install $$quiet -c constraints.txt
# pytest's own count takes two threads of one core for one.
WORKERS := $(shell nproc 2>/dev/null || echo auto)

.DEFAULT_GOAL := help
.PHONY: help setup demo cluster cluster-down demo-cluster test testbed crash-test lint generate bench format clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 18

setup: $(VENV)/.installed ## a virtual environment with the fleet command

demo: $(VENV)/.installed ## fly examples/crop-scouting end to end on this machine
	@$(BIN)/fleet run examples/crop-scouting/fleetspec.yaml --out $(OUT) --fresh

cluster: $(VENV)/.installed-dev ## a real Kubernetes of one hub and three edge machines on this computer (Linux, root)
	@$(BIN)/python -m tests.testbed up

cluster-down: $(VENV)/.installed-dev ## end it
	@$(BIN)/python -m tests.testbed down

demo-cluster: $(VENV)/.installed-dev ## helm install, kubectl apply, three missions over HDFS on that cluster, report
	@$(BIN)/python -m tests.testbed.demo

test: $(VENV)/.installed-dev testbed ## every test
	@$(BIN)/python -m pytest -n $(WORKERS) --maxprocesses 8 --dist loadgroup

testbed: $(VENV)/.installed-dev ## build what the tests on real clusters need: Kubernetes, HDFS, images (once; 15 minutes)
	@$(BIN)/python -m tests.testbed build --if-possible kubernetes etcd containerd coredns helm hadoop images

crash-test: $(VENV)/.installed-dev testbed ## kill the operator after each of its writes, and compare the results
	@$(BIN)/python -m tests.crash --all

lint: $(VENV)/.installed-dev ## style, types, layers, generated files
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/mypy
	@PYTHONPATH=.:operator $(BIN)/lint-imports --no-cache
	@$(BIN)/python -m fleet.spec.generate --check

generate: $(VENV)/.installed ## write crds/ and docs/reference/ from the models of the spec
	@$(BIN)/python -m fleet.spec.generate

bench: $(VENV)/.installed-dev ## measure; prints ratios, writes bench/out/results.json
	@$(BIN)/python -m bench.run

format: $(VENV)/.installed-dev ## put the code in the project's format
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

clean: ## remove everything that can be made again
	@rm -rf $(VENV) out build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis bench/out

# Says that the environment is not in the middle of something: pip takes what it left half there for installed, so an
# environment that was broken off is made anew. A fresh Debian or Ubuntu has python3 without the part that makes them.
$(VENV)/.whole:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or later is needed; name one with: make PYTHON=/path/to/python3 ..." >&2; exit 1; }
	@echo "set-up: a virtual environment in $(VENV)"
	@if [ -e $(VENV)/.ours ]; then rm -rf $(VENV); fi
	@if [ -e $(VENV) ]; then \
	  echo "set-up: $(VENV) was not made by make, and stays as it is; move it away, or choose another with VENV=" >&2; \
	  exit 1; fi
	@mkdir -p $(VENV) && touch $(VENV)/.ours
	@$(PYTHON) -m venv $(VENV) >/dev/null 2>&1 || { \
	  echo "set-up: installing python3-venv, which this system lacks"; \
	  if [ "$$(id -u)" = 0 ]; then SUDO=; else SUDO=sudo; fi; \
	  $$SUDO apt-get update -qq && \
	  $$SUDO env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq python3-venv >/dev/null && \
	  $(PYTHON) -m venv $(VENV); } || \
	  { echo "set-up: no virtual environment; install python3-venv, or name another Python with PYTHON=" >&2; exit 1; }
	@touch $@

$(VENV)/.installed: pyproject.toml constraints.txt $(VENV)/.whole
	@echo "set-up: the packages of the Fleet Computer (about a minute)"
	@rm -f $(VENV)/.whole
	@$(PIP) -e .
	@touch $(VENV)/.whole $@

$(VENV)/.installed-dev: $(VENV)/.installed
	@echo "set-up: the packages of the tests, PyTorch among them (some minutes, 6 GB)"
	@rm -f $(VENV)/.whole
	@$(PIP) -e '.[dev,deep]'
	@touch $(VENV)/.whole $(VENV)/.installed $@
