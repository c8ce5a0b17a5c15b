# Newcomers need only two commands: `make demo` and `make test`.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help demo gpu lab test kernels test-all test-web-units test-python test-slow test-alone test-extended fuzz lint lint-python lint-web lint-compose lint-github lock format docs bench paper paper-archive bench-gpu bench-hostile bench-load bench-soak dist release images clean

PYTHON ?= python3
# The index of PyTorch's CPU build.
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
# Another models directory than models/. The built-in demo scene is always available.
SCENES ?=

# A part of the published evaluation, and a folder of recordings and scenes, which most need: make paper PART=rtt DATA=../shared
PART ?=
DATA ?=

# Inputs that `make fuzz` tries in each fuzzer.
EXAMPLES ?= 1000

# Tests start hundreds of Python processes, which would compile all modules again.
unexport PYTHONDONTWRITEBYTECODE

VENV := .venv/bin
PIP := $(VENV)/pip install --disable-pip-version-check
UV_SYNC := $(VENV)/uv sync --frozen --inexact --no-default-groups
STATIC := services/render/tigas_render/static/index.html

help:
	@echo "make demo          install dependencies, start the demo and print its URL"
	@echo "make test          install dependencies and run the fast tests (at most 6 minutes)"
	@echo "make test-all      run nearly all tests: also browsers, the shaped link and containers (at most 25 minutes)"
	@echo "make test-extended run the longest tests, of parts that seldom change"
	@echo "make fuzz          try EXAMPLES=1000 random inputs in each fuzzer (about 20 minutes)"
	@echo "make paper         list the parts of the published evaluation; PART=quick makes one, into results/paper/ (10 minutes, needs root)"
	@echo "make paper-archive pack its runs into results/paper.tar.xz"
	@echo "make lint          check types, style and generated files"
	@echo "make bench         measure speed and memory against baselines (about 10 minutes)"
	@echo "make bench-hostile measure a polite viewer while somebody else attacks (over half an hour; needs root for all of it)"
	@echo "make bench-soak    run services and page for two hours while services are killed: memory and open files must not grow (needs Chromium)"
	@echo "make bench-load    find how many viewers the render service serves, and overload it twofold (about 3 minutes)"
	@echo "make gpu           install GPU support for NVIDIA, as in: make gpu demo"
	@echo "make lab           install experiments and their store, reports and training, as in: make lab demo"
	@echo "make bench-gpu     measure GPU rendering (needs a GPU)"
	@echo "make lock          update uv.lock after a change of pyproject.toml"
	@echo "make release       build wheel and source archive with the page in them, the npm package of the viewer, and lists of all that they need (SBOM), into dist/, and images"
	@echo "make format        format the code and fix what can be fixed automatically"
	@echo "make docs          build the documentation site into site/"
	@echo "make clean         remove installed dependencies, build outputs and caches"

# Options of `tigas render` that the shaped link lacks.
UNSHAPED = $(filter-out --https --https=%,$(filter --%,$(ARGS)))

# The Python side, including the rasteriser's kernels, is prepared while the page is built.
demo:
	@$(MAKE) --no-print-directory -j2 kernels $(STATIC)
	@export TIGAS_SHAPER_TRACES=traces/network $(if $(SCENES),TIGAS_RENDER_SCENES=$(SCENES)); \
	if [ "$(UNSHAPED)" ]; then \
		echo "== without the shaped link, which has no $(UNSHAPED)"; \
	elif $(VENV)/tigas lab check $(ARGS); then \
		echo "== behind a shaped link: replay traces from the page's network panel"; \
		exec $(VENV)/tigas lab up $(ARGS); \
	elif [ $$? = 2 ]; then \
		exit 2; \
	else \
		echo "== without the shaped link; everything else works"; \
	fi; \
	exec $(VENV)/tigas demo -- $(ARGS)

PYTEST = $(VENV)/python -m pytest

# Two tiers, and the longest tests apart. `make -k test-all` goes on after a failure.
test: test-web-units test-python

test-all: test test-slow test-alone

test-python test-slow test-alone: .venv/.ready $(STATIC) kernels

# Compiled once: otherwise every test process would compile them at the same time.
kernels: .venv/.demo
	@echo "== CPU rasteriser: compiling its kernels (once)"
	@$(VENV)/python -c "from tigas_render.raster.cpu import CpuRasterizer; CpuRasterizer().warm_up()"

test-web-units: web/node_modules/.ready
	@echo "== web client: unit tests"
	@cd web && npm test --silent

test-python:
	@echo "== Python tests, on two cores"
	@$(PYTEST) -n 2 --dist loadfile

# Both in the order of the folders: a process that has driven browsers in tests/web runs no asyncio tests any more.
test-slow:
	@echo "== slow tests, on two cores"
	@$(PYTEST) --durations=15 -n 2 --dist loadfile --no-loadscope-reorder -m 'slow and not alone and not extended'

test-alone:
	@echo "== tests that measure time or use fixed ports, one by one"
	@$(PYTEST) -m 'alone and not extended' $$(grep -rl --include='*.py' 'mark\.alone' tests | sort)

test-extended: .venv/.ready $(STATIC)
	@$(PYTEST) -m extended

fuzz: .venv/.ready web/node_modules/.ready
	@cd web && VITE_FUZZ_EXAMPLES=$(EXAMPLES) npx vitest run --test-timeout=0 fuzz
	@TIGAS_FUZZ_EXAMPLES=$(EXAMPLES) $(VENV)/python -m pytest tests/fuzz --timeout=0 --tb=short $(ARGS)

# `make -j2 lint` does both sides at once.
lint: lint-python lint-web lint-compose lint-github

lint-python: .venv/.ready
	@echo "== ruff, mypy"
	@$(VENV)/ruff check . && $(VENV)/ruff format --check . && $(VENV)/mypy

lint-web: .venv/.ready web/node_modules/.ready
	@echo "== web client: biome, tsc, generated types"
	@cd web && npm run --silent check && npm run --silent wire -- --check

lint-compose:
	@echo "== compose.yaml, compose.cluster.yaml"
	@if docker compose version >/dev/null 2>&1; then docker compose --profile monitoring config -q && docker compose -f compose.cluster.yaml config -q; else echo "not checked: Docker or its Compose plugin is missing"; fi

lint-github: .venv/.ready
	@echo "== .github"
	@$(VENV)/check-jsonschema --quiet --builtin-schema vendor.github-workflows .github/workflows/*.yml
	@$(VENV)/check-jsonschema --quiet --builtin-schema vendor.dependabot .github/dependabot.yml
	@$(VENV)/check-jsonschema --quiet --builtin-schema vendor.github-issue-forms .github/ISSUE_TEMPLATE/[!c]*.yml

format: .venv/.ready web/node_modules/.ready
	@$(VENV)/ruff check --fix . ; $(VENV)/ruff format .
	@cd web && npm run --silent fix

docs: .venv/.demo
	@$(UV_SYNC) --quiet --group dev
	@NO_MKDOCS_2_WARNING=1 $(VENV)/mkdocs build --quiet && echo "The documentation is in site/index.html."

lock: .venv/.demo
	@$(VENV)/uv lock

paper: .venv/.lab $(STATIC)
	@$(VENV)/tigas paper $(PART) $(if $(DATA),--data $(DATA)) $(ARGS)

paper-archive: .venv/.lab
	@$(VENV)/tigas report results/paper --without-pictures --archive results/paper.tar.xz

bench: .venv/.ready
	@$(VENV)/python -m benchmarks.raster
	@$(VENV)/python -m benchmarks.transport
	@$(VENV)/python -m benchmarks.memory
	@$(VENV)/python -m benchmarks.dash

bench-load: .venv/.ready
	@$(VENV)/python -m benchmarks.load $(ARGS)

bench-gpu: .venv/.gpu
	@$(VENV)/python -m benchmarks.gpu $(ARGS)
	@$(VENV)/python -m benchmarks.gpu_huge

bench-soak: .venv/.ready $(STATIC) kernels
	@$(VENV)/python -m benchmarks.soak $(ARGS)

bench-hostile: .venv/.ready
	@$(VENV)/python -m benchmarks.hostile $(ARGS)

gpu: .venv/.gpu

lab: .venv/.lab

# Dependencies come from uv.lock, with their hashes checked. uv itself is installed by pip, from its entry in the lock.
.venv/.demo: pyproject.toml uv.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { echo "TIGAS needs Python 3.11 or newer: make demo PYTHON=python3.12"; exit 1; }
	@echo "== Python environment in .venv"
	@$(PYTHON) -m venv .venv || { echo "Python cannot create virtual environments: sudo apt-get install python3-venv"; exit 1; }
	@$(PIP) --require-hashes -r <($(VENV)/python deploy/uv_requirement.py)
	@$(UV_SYNC) --group build --extra render --extra dash --extra shaper
	@touch $@

.venv/.gpu: .venv/.demo
	@$(UV_SYNC) --extra gpu --reinstall-package torch
	@touch $@

# PyTorch and the packages that only its CUDA build needs.
CUDA = $(shell sed -nE 's/^name = "(torch|triton|cuda-.*|nvidia-.*)"$$/\1/p' uv.lock)
TORCH = torch==$(shell sed -n '/^name = "torch"$$/{n;s/version = "\(.*\)"/\1/p}' uv.lock)

.venv/.lab: .venv/.demo
	@echo "== Python environment in .venv: experiments, reports and training"
	@$(UV_SYNC) --extra lab $(CUDA:%=--no-install-package %)
	@$(PIP) --no-deps --retries 1 --extra-index-url $(TORCH_INDEX) $(TORCH)
	@touch $@

.venv/.ready: .venv/.lab
	@echo "== Python environment in .venv: tests"
	@$(UV_SYNC) --extra cluster --group dev
	@touch $@

# Only the packages that build the page: without types, source maps, debug builds and other module formats, which are most of it.
UNUSED := typescript @typescript dashjs/dist/legacy dashjs/dist/modern/umd lucide/dist/cjs lucide/dist/umd \
	playcanvas/build/playcanvas.* mediabunny/dist/bundles mediabunny/src
web/node_modules/.build: web/package.json web/package-lock.json
	@node -e 'const [major, minor] = process.versions.node.split("."); process.exit(major > 22 || (major == 22 && minor >= 12) || (major == 20 && minor >= 19) ? 0 : 1)' 2>/dev/null || { echo "The web client needs Node.js 20.19, or 22.12 or newer: https://nodejs.org"; exit 1; }
	@echo "== web client: dependencies of the page"
	@cd web && npm ci --omit=dev --omit=peer --no-audit --no-fund --loglevel=error
	@cd web/node_modules && rm -rf $(UNUSED) && find . -name '*.map' -delete -o -name '*.debug.js' -delete
	@touch $@

web/node_modules/.ready: web/node_modules/.build
	@echo "== web client: dependencies of tests and checks"
	@cd web && npm ci --no-audit --no-fund --loglevel=error
	@touch web/node_modules/.build $@

$(STATIC): web/node_modules/.build $(shell find web/app web/packages web/public web/scripts web/index.html web/vite.config.ts -type f 2>/dev/null)
	@echo "== web client: build"
	@cd web && npm run --silent build
	@touch $@

# The extras that images install.
SBOM_EXTRAS := cluster dash gpu lab render shaper
VERSION = $(shell $(VENV)/python -c 'import tomllib; print(tomllib.load(open("pyproject.toml", "rb"))["project"]["version"])')

dist: .venv/.demo web/node_modules/.ready $(STATIC)
	@rm -rf dist
	@$(VENV)/uv build --quiet --no-build-isolation --out-dir dist
	@$(foreach extra,$(SBOM_EXTRAS),$(VENV)/uv export --frozen --quiet --no-default-groups --extra $(extra) --format cyclonedx1.5 --preview-features sbom-export --output-file dist/tigas-$(extra).cdx.json >/dev/null &&) true
	@cd web && npm sbom --package-lock-only --omit dev --sbom-format cyclonedx >../dist/tigas-page.cdx.json
	@cd web && npm run --silent build:package && npm pack --silent --pack-destination ../dist ./dist-package >/dev/null
	@ls dist

release: .venv/.ready dist
	@$(VENV)/python -m pytest tests/test_release.py
	@if docker info >/dev/null 2>&1 && docker compose version >/dev/null 2>&1; then $(MAKE) --no-print-directory images; else echo "The images are not built: Docker or its Compose plugin is missing, or does not run."; fi

images:
	@TIGAS_COMMIT=$$(git describe --always --dirty --abbrev=12 --exclude='*') docker compose --project-name tigas build
	@for service in $$(docker compose config --services); do docker tag tigas-$$service tigas-$$service:$(VERSION); done
	@docker image ls --filter 'reference=tigas-*:$(VERSION)'

clean:
	rm -rf .venv dist site web/node_modules web/dist-package services/render/tigas_render/static .mypy_cache .ruff_cache .pytest_cache
