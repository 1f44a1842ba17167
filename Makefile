# make demo   set up everything, make a hologram of the shipped picture and render what an eye sees
# make test   set up everything, check style and types, run the tests (two files at a time; one: TESTS_AT_ONCE=0)
# make test RESEED=1   the same with every seed moved, by another amount for each number (also test-all, test-processors)
# make test-all   make test, then the tests that take long or explore: whole diagnoses, fuzzing, all studies, tutorials
# make test-processors  repeat the tests that depend most on the processor as if on others
# make test-pythons  install holoview with Python 3.12 and 3.13, where they are found, and run tests there
# make package  build the source distribution and the wheel into dist/
# make wheel  build the wheel, install it alone elsewhere and use it
# make docs   build the manual as a site, out/site/index.html
# make docs PAGE=docs/viewer.md   build this page anew into the site that is there, in seconds
# make tutorials  run the tutorials and write what they print and draw into their pages
# make pictures  draw the manual's pictures of the viewer anew, on an idle machine, whose times they show, and its figures
# make gallery  run every study at its quick scale and build docs/gallery.md (a quarter of an hour)
# make still-life  optimise the hologram with which the viewer opens (assets/still-life.safetensors)
# make fuzz   feed 20 000 hostile files and options and count how they end (CASES=20000 SEED=1; MINUTES=60 at most)
# make bench  time the frame's stages on this machine; ratios of times beside those kept for this processor
.PHONY: fuzz demo test test-all test-processors test-pythons wheel bench docs tutorials pictures gallery still-life lint \
	style types imports package clean help
.DEFAULT_GOAL := help
MAKEFLAGS += -j2 # what doesn't depend on each other is done two at a time: checks, and in .ci/run the manual and the wheel

BIN := .venv/bin
OUT ?= out/demo
TESTS_AT_ONCE ?= 2
RESEED ?= 0
export TORCH_INDEX TESTS_AT_ONCE RESEED
# Tests read hundreds of files in a fork each (holoview.util.reader_process), which copies the page tables of a process
# of a gigabyte: glibc's large pages, where Linux grants them, are a fifth less work. They change no result.
export GLIBC_TUNABLES ?= glibc.malloc.hugetlb=1
# Where the environment forbids them, each of the programs that tests start would compile the whole package anew.
export PYTHONDONTWRITEBYTECODE =

PYTEST := $(BIN)/python -m pytest -n $(TESTS_AT_ONCE) --dist loadfile --no-loadscope-reorder --reseed $(RESEED)

help:
	@sed -n 's/^# \(make .*\)/\1/p' Makefile

.venv/holoview.stamp: pyproject.toml .ci/constraints.txt .ci/setup
	@bash .ci/setup

demo: .venv/holoview.stamp
	@bash .ci/adapter
	@bash .ci/fonts
	@$(BIN)/holoview demo -o $(OUT) $(if $(ITERATIONS),--iterations $(ITERATIONS))

test: lint
	@bash .ci/adapter
	@bash .ci/window
	$(PYTEST)

test-all: test
	$(PYTEST) -m "(explores or long) and not slow"

test-processors: .venv/holoview.stamp
	@bash .ci/adapter
	@bash .ci/processors

test-pythons: .venv/holoview.stamp
	@bash .ci/pythons

lint: types style imports

style: .venv/holoview.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: .venv/holoview.stamp
	$(BIN)/mypy

imports: .venv/holoview.stamp
	$(BIN)/lint-imports

fuzz: .venv/holoview.stamp
	OMP_NUM_THREADS=1 nice -n 10 $(BIN)/python -m benchmarks.fuzz --cases $(or $(CASES),20000) --seed $(or $(SEED),1) \
		$(if $(MINUTES),--minutes $(MINUTES))

bench: .venv/holoview.stamp
	@bash .ci/adapter
	$(BIN)/python -m benchmarks.frame_time
	$(BIN)/python -m benchmarks.ratios

# Not --quiet: it hides warnings from --strict as well.
docs: .venv/holoview.stamp
ifdef PAGE
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m docs._hooks.one_page $(PAGE)
else
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict
	@echo "out/site/index.html: open it, or serve it for its search: $(BIN)/python -m http.server -d out/site"
endif

tutorials: .venv/holoview.stamp
	@bash .ci/adapter
	@$(BIN)/python -m docs._hooks.tutorials

pictures: .venv/holoview.stamp
	@bash .ci/adapter
	@$(BIN)/python -m docs._hooks.pictures
	@$(BIN)/python -m docs._hooks.figures

gallery: .venv/holoview.stamp
	@$(BIN)/python -m benchmarks.gallery

still-life: .venv/holoview.stamp
	$(BIN)/holoview optimise holochrome-8 assets/still-life.png --depth assets/still-life-depth.png --iterations 60 \
		--eyebox 0.01 --drive-type uint8 -o assets/still-life.safetensors

package: .venv/holoview.stamp
	rm -rf dist
	$(BIN)/python -m build

wheel: .venv/holoview.stamp
	@bash .ci/adapter
	@bash .ci/window
	@bash .ci/wheel

clean:
	rm -rf .venv out dist build
