# Every target a person needs; `make` alone lists them.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
PYTHON ?= python3
VENV := .venv
export PATH := $(CURDIR)/$(VENV)/bin:$(PATH)
export PYTHONHASHSEED := 0
export PYTHONUTF8 := 1
unexport $(shell git rev-parse --local-env-vars)  # of the hook or alias that started make: clones are made here
READY := $(VENV)/.ready
COMPILE := pip-compile --quiet --strip-extras --no-emit-index-url --no-emit-find-links --no-emit-trusted-host
RUN ?=
WORST ?=
ALL ?=
A ?=
B ?= HEAD
VERDICT ?=
SCENE ?=
NOTE ?=
override export NOTE := $(value NOTE)
KILLS ?=

.PHONY: help venv venv-cluster repro studies demo pull test test-browser test-viewer test-cluster test-faults check-dowhy smoke bench review reviewed audit tables readme docs dist lint lock sbom params segmenter data render clean

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*##/\t/' | expand -t 14

venv: $(READY)  ## create .venv from the pinned lock

$(READY): requirements-dev.lock
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 11) else f"error: Python {v.major}.{v.minor} found, 3.11 or newer needed: make PYTHON=python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -r requirements-dev.lock
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	@touch $@

$(VENV)/.robot: requirements-robot.lock $(READY)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -r requirements-robot.lock
	@touch $@

repro: data-here  ## the paper: data from the store, every stage, the report
	dvc repro
	@cmp -s {reports/recordings,outputs/record/runs}/recordings.csv || python -m pipeline.stages.record --params params.yaml  # DVC skips it where git has its results
	@dvc metrics show --md
	@echo "report: $(CURDIR)/reports/index.html"

studies: data-here $(VENV)/.robot  ## the paper and every study beyond it
	dvc repro -P

demo: $(READY)  ## a small run of the paper in demo/, from data to page in a few minutes; prints where the page is
	bash tests/smoke/run.sh --profile demo demo
	@echo "page: $(CURDIR)/demo/reports/index.html"

pull: data-here  ## data, and results where somebody pushed them to the remote
	@said=$$(dvc pull --allow-missing 2> .dvc/tmp/pull) || { cat .dvc/tmp/pull >&2; exit 1; }; \
	  sed '/^md5: /d; /Missing cache files:/d' .dvc/tmp/pull >&2; lacking=$$(grep -c '^md5: ' .dvc/tmp/pull || true); \
	  echo "data: here; results: $$(sed -n '$$s/^Everything is up to date.*/nothing new/; $$p' <<< "$$said")"; \
	  [ $$lacking = 0 ] || echo "results that the locks name and nobody pushed: $$lacking; \`make repro\` and \`make studies\` compute them"

# from store/, which lies in git, whatever remote results go to
DATA := --remote store data.dvc rendered/pictures.dvc
.PHONY: data-here
data-here: $(READY)
	@[ -s .dvc/tmp/rwlock ] || rm -f .dvc/tmp/rwlock  # emptied where DVC was killed as it wrote it: DVC would refuse to run
	@dvc pull --quiet $(DATA) || dvc pull $(DATA) || { echo "error: data/ or rendered/pictures/ is not what git names (see above):" \
	  "$$(if [ -n "$$(git status --porcelain store)" ]; then echo '`git checkout store` restores the store, from which they come'; \
	  elif [ -d data ] && [ -d rendered/pictures ]; then echo '`dvc checkout --force data.dvc rendered/pictures.dvc` drops your changes'; \
	  else echo 'store/ never had them: `dvc push $(DATA)` where they are'; fi)" >&2; exit 1; }
	@dvc fetch --quiet --remote store studies/*/dvc.yaml 2> /dev/null || true  # into the cache alone, for `dvc checkout`: `make studies` computes them

test: data-here  ## ruff, pyright, spelling, the test suite; `pytest -n 2 -m "not slow"` takes some three minutes
	ruff check . && ruff format --check .
	pyright
	codespell README.md CONTRIBUTING.md CHANGELOG.md docs conf pipeline studies reports
	python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

test-browser: $(READY)  ## the report in headless Chromium: keyboard, accessibility, phone, print
	@command -v chromium > /dev/null || { echo "error: chromium is missing: apt-get install chromium" >&2; exit 1; }
	python -m pytest tests/browser

test-viewer: $(READY)  ## recordings in Rerun's viewer, without a screen or a GPU
	@[ -n "$$(ls /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json 2> /dev/null)" ] || { echo "error: a Vulkan driver is missing: apt-get install mesa-vulkan-drivers" >&2; exit 1; }
	python -m pytest tests/screenshots

test-faults: $(READY)  ## break smoke runs on purpose (kill -9, damaged files, full disk, ...); Linux, root; KILLS=50 for more kills than 5
	python -m tests.faults $(if $(KILLS),--kills $(KILLS))

CLUSTER := .venv-cluster/.ready
$(CLUSTER): tests/cluster/requirements.txt $(READY)
	test -x .venv-cluster/bin/python || $(VENV)/bin/python -m venv .venv-cluster
	$(VENV)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))' > "$$(.venv-cluster/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/venv.pth"
	.venv-cluster/bin/python -m pip install --quiet --disable-pip-version-check -r tests/cluster/requirements.txt
	@touch $@

venv-cluster: $(CLUSTER)  ## create .venv-cluster above .venv: sweeps on Ray, by submitit on Slurm, and by Optuna

test-cluster: data-here $(CLUSTER)  ## sweeps on Ray (two nodes, one is killed) and by Optuna, Slurm's job file, in an environment above .venv
	PATH="$(CURDIR)/.venv-cluster/bin:$$PATH" .venv-cluster/bin/python -m pytest tests/cluster

check-dowhy:  ## a small graph's and the stages' own numbers by dowhy.gcm, in an environment of its own
	test -x .venv-dowhy/bin/python || $(PYTHON) -m venv .venv-dowhy
	.venv-dowhy/bin/python -m pip install --quiet --disable-pip-version-check -r tests/dowhy/requirements.txt
	PYTHONPATH=. .venv-dowhy/bin/python tests/dowhy/stages.py

smoke: $(READY)  ## the whole graph, studies too (execution after `make studies`), and sweeps, tiny, in throwaway clones, and what is promised of them
	python -m pytest -n 2 --dist loadfile tests/smoke

bench: data-here $(CLUSTER)  ## every benchmark, the whole graph among them; writes bench/README.md
	mkdir -p .benchmarks
	PATH="$(CURDIR)/.venv-cluster/bin:$$PATH" .venv-cluster/bin/python -m pytest bench --benchmark-only --benchmark-json=.benchmarks/latest.json
	python -m bench.repro .benchmarks/repro.json
	python -m bench.page .benchmarks/latest.json .benchmarks/repro.json

review: $(READY)  ## open the overview of the recordings; ALL=1: tables of all to sort and filter; RUN=<variant>-<user>-s<seed> or WORST=1: one; A=<commit> B=<commit>: two commits; WEB=1: in a browser
	python -m pipeline.viewer.review $(RUN) $(if $(WORST),--worst) $(if $(ALL),--all) $(if $(A),--between $(A) $(B)) $(if $(WEB),--web)

reviewed: $(READY)  ## note what you saw and commit it: RUN=<run> VERDICT=right|wrong|unclear, SCENE=<number> for one scene, NOTE="why"
	python -m pipeline.viewer.review $(RUN) --verdict $(VERDICT) $(if $(SCENE),--scene $(SCENE)) --note "$$NOTE"

audit: $(READY)  ## do code, locks, pages and tables of the last commit agree? docs/audit.md compares two commits
	python -m pipeline.audit

tables: $(READY)  ## the paper's Table 2 with its bold cells, in LaTeX and Markdown, in tables/
	python -m pipeline.report.exports tables

readme: $(READY)  ## put the tables of reports/ into the README: curve, Table 2, headlines
	python -m pipeline.report.exports readme

docs: $(READY)  ## the reference of all modules, from their docstrings: api/index.html
	pdoc -o api $(filter-out pipeline.__% pipeline.robot,$(subst /,.,$(patsubst %/,%,$(basename $(wildcard pipeline/*/ pipeline/*.py)))))

dist: $(READY)  ## wheel and sdist, in dist/; the notebook's code runs from the wheel, with nothing but what that needs
	rm -rf dist .venv-wheel
	python -m build --no-isolation
	$(PYTHON) -m venv .venv-wheel
	.venv-wheel/bin/python -m pip install --quiet --disable-pip-version-check dist/*.whl
	cd dist && ../.venv-wheel/bin/python -c 'import json; exec("".join("".join(c["source"]) + "\n" for c in json.load(open("../docs/library.ipynb"))["cells"] if c["cell_type"] == "code"))'

lint: $(READY)  ## format and lint in place
	ruff format . && ruff check --fix . && pyright

lock: $(READY)  ## pin pyproject.toml's dependencies anew
	$(COMPILE) --extra pipeline -o requirements.lock pyproject.toml
	$(COMPILE) --extra dev -c requirements.lock -o requirements-dev.lock pyproject.toml
	$(COMPILE) --extra robot -c requirements-dev.lock -o requirements-robot.lock pyproject.toml
	sed -i 's/^torch==\([0-9.]*\)+cpu/torch==\1/; /^causal-specifications @/,/# via/d' requirements*.lock  # either build of torch will do

sbom: $(READY)  ## software bill of materials of .venv with licences, sbom.json (CycloneDX), by a tool in an environment of its own
	test -x .venv-sbom/bin/python || $(PYTHON) -m venv .venv-sbom
	.venv-sbom/bin/python -m pip install --quiet --disable-pip-version-check cyclonedx-bom==7.5.0
	.venv-sbom/bin/cyclonedx-py environment --output-reproducible --output-file sbom.json $(VENV)

params: $(READY)  ## write params.yaml from conf/
	python -m pipeline.params

POOL := outputs/segmenter
segmenter: data-here  ## train perception anew on composites, 80 minutes on two cores; its weights are in git, so no other target needs it
	rm -rf $(POOL)
	python -m making.segmenter.pool --pool $(POOL) --parts 112 & python -m making.segmenter.train --pool $(POOL) --steps 14000 && wait

data: $(READY)  ## draw data/ anew and put it into the store
	python -m making.data
	dvc add data && dvc push --remote store data.dvc

render:  ## path-trace rendered/pictures/ anew by Blender, in an environment of its own (Python 3.11), and put it into the store; an hour and a half
	test -x .venv-rendered/bin/python || python3.11 -m venv .venv-rendered
	.venv-rendered/bin/python -m pip install --quiet --disable-pip-version-check -r making/render/requirements.txt
	set -- train 4 validation_taught 5 validation_held_out 7 test_taught 1272962571 test_held_out 1371790790; while [ $$# -gt 0 ]; do \
	    PYTHONPATH=. .venv-rendered/bin/python -m making.render --split $$1 --seed $$2 --into rendered/pictures/$$1; shift 2; done
	dvc add rendered/pictures && dvc push --remote store rendered/pictures.dvc

clean:  ## remove environments, demo/, other products but sweeps, and DVC's cache, with the results that nobody pushed
	rm -rf $(VENV) .venv-cluster .venv-dowhy .venv-rendered .venv-sbom .venv-wheel api dist sbom.json .benchmarks demo tables .dvc/cache .dvc/tmp
