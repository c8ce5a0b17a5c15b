# Newcomers need only two commands: `make demo` and `make test`.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help demo gpu test kernels test-web-units test-python test-pages test-timed-pages chromium test-slow test-compose fuzz lint lint-python lint-web lint-compose lock format bench compare bench-gpu bench-hostile bench-load release images clean

PYTHON ?= python3
# PyTorch's package index. Without an NVIDIA GPU, save gigabytes with
#   make demo TORCH_INDEX=https://download.pytorch.org/whl/cpu
TORCH_INDEX ?=
# Another models directory than models/. The built-in demo scene is always available.
SCENES ?=

# What `make compare` measures: make compare NETWORKS="5mbit,80ms-rtt my-trace.csv" ARGS="--duration 20"
NETWORKS ?= 20mbit,20ms-rtt traces/network/4g-bus.csv

# Inputs that `make fuzz` tries in each fuzzer.
EXAMPLES ?= 1000

VENV := .venv/bin
PIP := $(VENV)/pip install --disable-pip-version-check
STATIC := services/render/tigas_render/static/index.html

help:
	@echo "make demo          install dependencies, start the demo and print its URL"
	@echo "make test          install dependencies and run all tests, including browser tests, except slow and container tests"
	@echo "make test-slow     run the tests that take long and guard what changes seldom (about 8 minutes)"
	@echo "make test-compose  start the containers, test them over the shaped link and remove them"
	@echo "make fuzz          try EXAMPLES=1000 random inputs in each fuzzer (about 20 minutes)"
	@echo "make compare       compare one JPEG per pose with low-latency DASH over a shaped link, into results/ (about 10 minutes, needs root)"
	@echo "make lint          check types, style and generated files"
	@echo "make bench         measure speed and memory against baselines (about 10 minutes)"
	@echo "make bench-hostile measure a polite viewer while somebody else attacks (about 30 minutes; needs root for all of it)"
	@echo "make bench-load    find how many viewers the render service serves, and what becomes of twice as many (about 3 minutes)"
	@echo "make gpu           install GPU support for NVIDIA, as in: make gpu demo"
	@echo "make bench-gpu     measure GPU rendering (needs a GPU)"
	@echo "make lock          write the locks after a change of pyproject.toml or constraints.txt"
	@echo "make release       build wheel and source archive with the page in them, and lists of all that they need (SBOM), into dist/, and images"
	@echo "make format        format the code and fix what can be fixed automatically"
	@echo "make clean         remove installed dependencies, build outputs and caches"

demo: .venv/.ready $(STATIC)
	@if $(VENV)/tigas lab check $(ARGS); then \
		echo "== behind a shaped link: replay traces from the page's network panel"; \
		exec $(VENV)/tigas lab up --traces traces/network $(if $(SCENES),--scenes $(SCENES)) $(ARGS); \
	else \
		echo "== without the shaped link; everything else works"; \
		exec $(VENV)/tigas demo -- $(if $(SCENES),--scenes $(SCENES)) $(ARGS); \
	fi

# Browser tests that measure time: one by one. Those in tests/web cannot share a process with the tests before them.
TIMED_PAGES := $(addprefix tests/web/test_,adaptation.py connection.py dash_reprojection.py modes.py motion_to_photon.py refinement.py \
	reprojection.py)
ONE_BY_ONE := tests/experiments/run/test_bridge.py $(TIMED_PAGES)
# Tests in network namespaces: one by one, since some use the same lab, and beside others, since they wait most of the time;
# after them others that wait, for as long as the rest takes.
BESIDE := tests/testbed tests/experiments/commands/test_compare_testbed.py tests/cluster tests/dash tests/enhance
# Whole services and browsers share two cores here. A test that a busy machine fails is run once more, and the summary names it.
PYTEST = $(VENV)/python -m pytest --reruns 1

# `make -k test` goes on to the next group after a failure.
test: test-web-units test-python test-pages test-timed-pages

test-python: kernels

test-python test-pages test-timed-pages: .venv/.ready $(STATIC) chromium

# Once: otherwise all of the tests' processes would compile them at the same time.
kernels: .venv/.ready
	@echo "== CPU rasteriser: kernels"
	@$(VENV)/python -c "from tigas_render.raster.cpu import CpuRasterizer; CpuRasterizer().warm_up()"

test-web-units: web/node_modules/.ready
	@echo "== web client: unit tests"
	@cd web && npm test --silent

test-python:
	@echo "== Python tests, on two cores; beside them those that wait most of the time, whose results follow"
	@log=$$(mktemp); $(PYTEST) $(BESIDE) >$$log 2>&1 & beside=$$!; \
	$(PYTEST) -n 2 --dist loadfile $(patsubst %,--ignore=%,tests/web tests/experiments/run/test_bridge.py $(BESIDE)); others=$$?; \
	wait $$beside; beside=$$?; cat $$log; rm $$log; exit $$((others || beside))

test-pages:
	@echo "== Browser tests, on two cores"
	@$(PYTEST) -n 2 --dist loadfile tests/web $(TIMED_PAGES:%=--ignore=%)

test-timed-pages:
	@echo "== Browser tests that measure time, one by one"
	@$(PYTEST) $(ONE_BY_ONE)

chromium:
	@command -v chromium >/dev/null || { echo "The browser tests need Chromium: sudo apt-get install chromium"; exit 1; }

test-slow: .venv/.ready $(STATIC) chromium
	@$(PYTEST) -m slow --ignore=tests/web
	@$(PYTEST) -m slow tests/web

test-compose: .venv/.ready
	@$(VENV)/python -m pytest tests/compose -m compose -s

fuzz: .venv/.ready web/node_modules/.ready
	@cd web && VITE_FUZZ_EXAMPLES=$(EXAMPLES) npx vitest run --test-timeout=0 fuzz
	@TIGAS_FUZZ_EXAMPLES=$(EXAMPLES) $(VENV)/python -m pytest tests/fuzz --timeout=0 --tb=short $(ARGS)

# `make -j2 lint` does both sides at once.
lint: lint-python lint-web lint-compose

lint-python: .venv/.ready
	@echo "== ruff, mypy"
	@$(VENV)/ruff check . && $(VENV)/ruff format --check . && $(VENV)/mypy

lint-web: .venv/.ready web/node_modules/.ready
	@echo "== web client: biome, tsc, generated types"
	@cd web && npm run --silent check && npm run --silent wire -- --check

lint-compose:
	@echo "== compose.yaml, compose.cluster.yaml"
	@if docker compose version >/dev/null 2>&1; then docker compose --profile monitoring config -q && docker compose -f compose.cluster.yaml config -q; else echo "not checked: Docker or its Compose plugin is missing"; fi

format: .venv/.ready web/node_modules/.ready
	@$(VENV)/ruff check --fix . ; $(VENV)/ruff format .
	@cd web && npm run --silent fix

lock: .venv/.ready
	@$(VENV)/python -m locks.update

compare: .venv/.ready $(STATIC)
	@$(VENV)/tigas compare $(foreach network,$(NETWORKS),--network $(network)) --profile budget --profile 2 $(if $(SCENES),--scenes $(SCENES)) $(ARGS)

bench: .venv/.ready $(STATIC)
	@$(VENV)/python -m benchmarks.raster
	@$(VENV)/python -m benchmarks.footprint
	@$(VENV)/python -m benchmarks.transport
	@$(VENV)/python -m benchmarks.quic_cost
	@$(VENV)/python -m benchmarks.memory
	@$(VENV)/python -m benchmarks.dash
	@$(VENV)/python -m benchmarks.sampling

bench-load: .venv/.ready
	@$(VENV)/python -m benchmarks.load $(ARGS)

bench-gpu: .venv/.gpu
	@$(VENV)/python -m benchmarks.gpu $(ARGS)

bench-hostile: .venv/.ready
	@$(VENV)/python -m benchmarks.hostile $(ARGS)

gpu: .venv/.gpu

.venv/.gpu: .venv/.ready
	@$(PIP) -q --require-hashes -r locks/gpu.txt
	@$(PIP) -q -c constraints.txt --no-build-isolation -e '.[gpu]'
	@$(VENV)/python -c 'import sys, torch; sys.exit(torch.version.cuda is None)' || { echo "The installed PyTorch has no CUDA support: run make clean, then make gpu without TORCH_INDEX"; exit 1; }
	@touch $@

# First what the lock has, whose files are checked, then the project with what is left: PyTorch, and the CUDA libraries of one for GPUs.
.venv/.ready: pyproject.toml constraints.txt locks/dev.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "TIGAS needs Python 3.11 or newer: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@echo "== Python environment in .venv (the first install takes minutes: PyTorch is large)"
	@$(PYTHON) -m venv .venv || { echo "Python cannot create virtual environments: sudo apt-get install python3-venv"; exit 1; }
	@$(if $(TORCH_INDEX),$(PIP) -q -c constraints.txt --index-url $(TORCH_INDEX) --no-deps torch)
	@set -o pipefail; { $(PIP) --progress-bar on --require-hashes -r locks/dev.txt && \
		$(PIP) --progress-bar on -c constraints.txt --no-build-isolation -e '.[dev]'; } | grep -E '^(Collecting|Downloading|Successfully)' || { echo "pip failed: run it again to see why"; exit 1; }
	@touch $@

web/node_modules/.ready: web/package.json web/package-lock.json
	@node -e 'const [major, minor] = process.versions.node.split("."); process.exit(major > 22 || (major == 22 && minor >= 12) || (major == 20 && minor >= 19) ? 0 : 1)' 2>/dev/null || { echo "The web client needs Node.js 20.19, or 22.12 or newer: https://nodejs.org"; exit 1; }
	@echo "== web client: dependencies"
	@cd web && npm ci --no-audit --no-fund --loglevel=error
	@touch $@

$(STATIC): web/node_modules/.ready $(shell find web/src web/public web/index.html web/vite.config.ts -type f 2>/dev/null)
	@echo "== web client: build"
	@cd web && npm run --silent build
	@touch $@

# What the images install, by extra: their locks, and PyTorch, which is in none, for those on GPUs; and what the page has in it.
SBOM_EXTRAS := cluster gpu render shaper store webrtc
SBOM := PYTHONWARNINGS=ignore $(VENV)/uv tool run --quiet --from cyclonedx-bom==7.5.0 cyclonedx-py requirements - --pyproject pyproject.toml --output-reproducible
TORCH_EXTRAS := gpu
VERSION = $(shell $(VENV)/python -c 'import tomllib; print(tomllib.load(open("pyproject.toml", "rb"))["project"]["version"])')

release: .venv/.ready $(STATIC)
	@rm -rf dist
	@$(VENV)/uv build --quiet --out-dir dist
	@set -o pipefail; $(foreach extra,$(SBOM_EXTRAS),{ cat locks/$(extra).txt; $(if $(filter $(extra),$(TORCH_EXTRAS)),grep ^torch== constraints.txt;) } | $(SBOM) -o dist/tigas-$(extra).cdx.json &&) true
	@cd web && npm sbom --package-lock-only --omit dev --sbom-format cyclonedx >../dist/tigas-page.cdx.json
	@$(VENV)/python -m pytest tests/test_release.py
	@ls dist
	@if docker info >/dev/null 2>&1 && docker compose version >/dev/null 2>&1; then $(MAKE) --no-print-directory images; else echo "The images are not built: Docker or its Compose plugin is missing, or does not run."; fi

images:
	@TIGAS_COMMIT=$$(git describe --always --dirty --abbrev=12 --exclude='*') docker compose --project-name tigas build
	@for service in $$(docker compose config --services); do docker tag tigas-$$service tigas-$$service:$(VERSION); done
	@docker image ls --filter 'reference=tigas-*:$(VERSION)'

clean:
	rm -rf .venv dist web/node_modules services/render/tigas_render/static .mypy_cache .ruff_cache .pytest_cache
