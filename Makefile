# Every target a person needs; `make` alone lists them.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
PYTHON ?= python3
VENV := .venv
export PATH := $(CURDIR)/$(VENV)/bin:$(PATH)
export PYTHONHASHSEED := 0
READY := $(VENV)/.ready
RUN ?=
WORST ?=

.PHONY: help venv repro test test-browser test-viewer test-latex check-dowhy smoke bench review picture pictures readme lint lock deps data clean

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*##/\t/' | expand -t 14

venv: $(READY)  ## create .venv from the pinned lock

$(READY): requirements.lock requirements-dev.lock
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 11) else f"error: Python {v.major}.{v.minor} found, 3.11 or newer needed: make PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -r requirements-dev.lock
	@touch $@

repro: $(READY)  ## the whole experiment: data from the store, every stage, the report
	@[ -s .dvc/tmp/rwlock ] || rm -f .dvc/tmp/rwlock  # emptied where DVC was killed as it wrote it: DVC would refuse to run
	dvc pull --allow-missing --quiet data.dvc
	dvc repro
	python -m pipeline.report.terminal

test: $(READY)  ## ruff, pyright, the test suite (it includes the smoke run)
	dvc pull --allow-missing --quiet data.dvc
	ruff check . && ruff format --check .
	pyright
	python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

test-browser: $(READY)  ## the report in headless Chromium: keyboard, accessibility, phone, print
	@command -v chromium > /dev/null || { echo "error: chromium is missing: apt-get install chromium" >&2; exit 1; }
	python -m pytest tests/browser

test-viewer: $(READY)  ## recordings in Rerun's viewer, without a screen or a GPU
	@[ -n "$$(ls /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json 2> /dev/null)" ] || { echo "error: a Vulkan driver is missing: apt-get install mesa-vulkan-drivers" >&2; exit 1; }
	python -m pytest tests/viewer

test-latex: $(READY)  ## the report's LaTeX tables, compiled
	@command -v pdflatex > /dev/null || { echo "error: pdflatex is missing: apt-get install texlive-latex-recommended" >&2; exit 1; }
	python -m pytest tests/latex

check-dowhy:  ## a small graph's and the stages' own numbers by dowhy.gcm, in an environment of its own
	test -x .venv-dowhy/bin/python || $(PYTHON) -m venv .venv-dowhy
	.venv-dowhy/bin/python -m pip install --quiet --disable-pip-version-check -r tests/dowhy/requirements.txt
	PYTHONPATH=. .venv-dowhy/bin/python tests/dowhy/toy.py
	PYTHONPATH=. .venv-dowhy/bin/python tests/dowhy/stages.py

smoke: $(READY)  ## the whole real graph, tiny, in a throwaway clone
	bash tests/smoke.sh

bench: $(READY)  ## every benchmark, the whole graph among them; writes bench/README.md
	mkdir -p .benchmarks
	dvc pull --allow-missing --quiet data.dvc
	python -m pytest bench --benchmark-only --benchmark-json=.benchmarks/latest.json
	python -m bench.repro .benchmarks/repro.json
	python -m bench.page .benchmarks/latest.json .benchmarks/repro.json

review: $(READY)  ## open the overview of the recordings, or one of them: RUN=full-careful-s0, or WORST=1
	python -m pipeline.recording.review $(RUN) $(if $(WORST),--worst)

picture: $(READY)  ## a picture of a recording, made without a screen: RUN=full-careful-s0; writes picture.png
	python -m pipeline.recording.picture $(or $(RUN),overview) picture.png $(if $(RUN),,0 scene 0)

pictures: $(READY)  ## the README's and the report's pictures of recordings, made without a screen
	python -m pipeline.recording.picture overview docs/pictures/overview.png 0 scene 0
	python -m pipeline.recording.picture path-careful-s0 docs/pictures/repairs.png
	python -m pipeline.recording.picture full-careful-s0 docs/pictures/learning.png 5 train_step 500
	dvc repro report

lint: $(READY)  ## format and lint in place
	ruff format . && ruff check --fix . && pyright

lock: $(READY)  ## pin requirements*.in anew
	pip-compile --quiet --strip-extras --no-emit-index-url --no-emit-find-links --no-emit-trusted-host -o requirements.lock requirements.in
	pip-compile --quiet --strip-extras --no-emit-index-url --no-emit-find-links --no-emit-trusted-host -o requirements-dev.lock requirements-dev.in
	sed -i 's/^torch==\([0-9.]*\)+cpu/torch==\1/' requirements.lock requirements-dev.lock  # either build will do

readme: $(READY)  ## put two of the report's tables into the README
	python -m pipeline.report.readme

deps: $(READY)  ## write each stage's import closure into dvc.yaml
	python -m pipeline.dependencies --write

data: $(READY)  ## draw data/ anew and put it into the store
	python -m drawing
	dvc add data && dvc push data.dvc

clean:  ## remove the environment and DVC's cache
	rm -rf $(VENV) .dvc/cache .dvc/tmp
