# Leafcloud. `make` lists the targets.
#
# Stamp files in every environment (.blender, .wheel, .test …) record the time of each installation, so that make skips
# whatever is up to date.

MAKEFLAGS += --no-builtin-rules
.NOTPARALLEL:
.DEFAULT_GOAL := help

# The file to bake: a .glb, .gltf, .obj or .blend. Default: the measured pine beside the repository, or the small shrub in it.
MEASURED := ../shared/foliage/pine_cards_20k.glb
INPUT ?= $(if $(wildcard $(MEASURED)),$(MEASURED),examples/shrub.glb)
OUT ?= out
ARGS ?=
# Duration of each fuzz target.
SECONDS ?= 600

# pyo3's build reads a Python's configuration. The same Python everywhere avoids rebuilding it.
export PYO3_PYTHON := $(CURDIR)/.venv/bin/python

OTHER_BLENDERS := tests/blender tests/bake/test_bake.py -m 'not browser'

# The core that all tests use: built with checks (profile dev in Cargo.toml). Rust's tests take the same features, so that nothing is
# compiled twice.
CORE := target/core
CHECKED := --locked --features leafcloud-python/extension-module

PIP_INSTALL = bin/python -m pip install --quiet --disable-pip-version-check
WHEELS := target/wheels
RUST_SOURCES := $(shell find rust -type f -not -name '*.pyc') $(wildcard Cargo.toml Cargo.lock) pyproject.toml THIRD_PARTY_LICENSES.txt
VALIDATOR := tests/gltf_validator
THREE := engines/three
NODE_MODULES := $(foreach folder,$(VALIDATOR) $(THREE) engines/babylon,$(folder)/node_modules/.package-lock.json)

.PHONY: help
help: ## list the targets
	@sed -nE 's/^([a-z-]+):[^#]*## (.*)/\1\t\2/p' Makefile | expand -t 18

.PHONY: setup
setup: .venv/.wheel .venv/.batch ## make .venv: Python 3.11 with Blender 4.5 LTS as a module and the release build of the wheel

.PHONY: bake
bake: setup ## bake a tree: make bake INPUT=tree.glb OUT=out ARGS='--epsilon 0.04 …'
	.venv/bin/python bake.py --input "$(INPUT)" --out "$(OUT)" $(ARGS)

.PHONY: test
test: .venv/.batch .venv/.test $(CORE)/.installed target/.rust-tested .venv-supply/.installed $(NODE_MODULES) ## run the tests of Rust and of Python in Blender 4.5 (ARGS='-k name' for pytest)
	@tools/prerequisites.sh chromium
	tools/phase.sh "Python's tests in Blender 4.5" tools/run_tests.sh .venv -m 'not night' $(ARGS)

# What depends on Blender's version, and one whole bake.
.PHONY: test-versions
test-versions: .venv-4.2/.test .venv-5.0/.test $(CORE)/.installed ## run the tests that depend on Blender's version in Blender 4.2 and 5.0
	tools/phase.sh "Blender 4.2" tools/run_tests.sh .venv-4.2 -m 'version and not night'
	tools/phase.sh "Blender 5.0" tools/run_tests.sh .venv-5.0 -m 'version and not night'

# The release build has to give the same bytes as that of the tests (tools/same_bytes.sh).
.PHONY: test-night
test-night: setup environments .venv/.test .venv/.fidelity $(CORE)/.installed ## run all tests: also measured trees, large inputs, many repetitions, and whole suites in Blender 4.2 and 5.0 (two hours)
	tools/phase.sh "Rust's tests" cargo test --workspace --tests $(CHECKED) -- --include-ignored
	tools/phase.sh "the same bytes" tools/same_bytes.sh
	tools/phase.sh "Python's tests in Blender 4.5" tools/run_tests.sh .venv tests bench
	tools/phase.sh "Blender 4.2" tools/run_tests.sh .venv-4.2 $(OTHER_BLENDERS)
	tools/phase.sh "Blender 5.0" tools/run_tests.sh .venv-5.0 $(OTHER_BLENDERS)
	$(if $(BLENDER),$(MAKE) test-interface)
	$(if $(GODOT),$(MAKE) test-godot)

.PHONY: mutants
mutants: ## put faults into the sources, one after the other, and tell whether make test finds them (two hours)
	@$$(tools/prerequisites.sh --find-python) tools/mutants.py

.PHONY: test-times
test-times: ## print where the time of the last tests went: phases, the sixty slowest tests, files
	@$$(tools/prerequisites.sh --find-python) tools/print_times.py

.PHONY: environments
environments: .venv-4.2/.test .venv-5.0/.test .venv-supply/.installed $(NODE_MODULES) ## download the other environments and packages of the tests
	@tools/prerequisites.sh chromium

.PHONY: bench
bench: ## measure the speed of the core (hours); make bench-NAME runs bench/NAME.py, see bench/README.md
	@tools/prerequisites.sh rust
	@mkdir -p docs/bench
	LEAFCLOUD_BENCH_JSON=$(CURDIR)/docs/bench/fit.json cargo bench --quiet --package leafcloud --bench fit | tee docs/bench/fit.md
	cargo bench --quiet --package leafcloud --bench pages | tee docs/bench/packing.md
	cargo bench --quiet --package leafcloud --bench pruning | tee docs/bench/pruning.md
	cargo bench --quiet --package leafcloud --bench safeguards -- $(CURDIR)/../shared/foliage/*.glb | tee docs/bench/safeguards.md

# The scripts import each other, the add-on, and the helpers of the tests.
bench-%: setup .venv/.fidelity .venv/.test $(NODE_MODULES)
	@tools/prerequisites.sh chromium
	@mkdir -p docs/bench
	PYTHONPATH=$(CURDIR):$(CURDIR)/tests/support .venv/bin/python bench/$(subst -,_,$*).py $(ARGS)

.PHONY: viewer
viewer: $(THREE)/node_modules/.package-lock.json ## show baked trees in a browser: http://localhost:8000/shaders/viewer/
	@tools/prerequisites.sh python
	@$$(tools/prerequisites.sh --find-python) -m http.server --bind 127.0.0.1 8000

# The fuzzer's instrumentation and AddressSanitizer need nightly Rust.
.PHONY: fuzz
fuzz: ## fuzz every target for ten minutes (SECONDS=60 for less); needs nightly Rust and cargo-fuzz
	@tools/prerequisites.sh rust
	@rustup toolchain list | grep -q nightly || { echo "leafcloud: make fuzz needs nightly: rustup toolchain install nightly" >&2; exit 1; }
	@cargo fuzz --version >/dev/null 2>&1 || { echo "leafcloud: make fuzz needs cargo-fuzz: cargo install cargo-fuzz" >&2; exit 1; }
	for target in fit pack raster read_gltf; do \
	    mkdir -p rust/fuzz/target/corpus/$$target; \
	    RAYON_NUM_THREADS=1 cargo +nightly fuzz run --fuzz-dir rust/fuzz $$target rust/fuzz/target/corpus/$$target rust/fuzz/corpus/$$target -- -max_total_time=$(SECONDS) -timeout=20 -rss_limit_mb=4096 || exit 1; \
	done

# With BLENDER and GODOT (see test-interface and test-godot) also their pictures, for docs/first_tree.md, docs/guide.md and docs/engines.md.
.PHONY: docs
docs: setup .venv/.test $(NODE_MODULES) ## remake the pictures of the documentation
	@tools/prerequisites.sh chromium
	PYTHONPATH=$(CURDIR):$(CURDIR)/tests/support .venv/bin/python bench/plantation.py
	.venv/bin/python tools/page_picture.py "$(INPUT)" docs/page.png
	@mkdir -p docs/engines
	.venv/bin/python tools/forest_picture.py "$(INPUT)" docs/engines/three_forest.png
	@mkdir -p docs/guide
	.venv/bin/python tools/landscape.py film out/film.png
	convert out/film.png -resize 640x +dither -colors 128 -define png:compression-level=9 docs/guide/film.png
ifdef BLENDER
	rm -rf out/interface
	$(MAKE) test-interface ARGS='-k first_session'
	@mkdir -p docs/interface
	for name in 1_start 2_sample 4_baked 5_level_1 7_labels 8_far; do \
	    convert out/interface/first_session/$$name.png -resize 50% +dither -colors 64 -define png:compression-level=9 docs/interface/$$name.png || exit 1; \
	done
endif
ifdef GODOT
	rm -rf out/landscape
	.venv/bin/python tools/landscape.py game out/landscape
	$$GODOT --headless --path out/landscape --import
	xvfb-run --auto-servernum $$GODOT --path out/landscape --rendering-method forward_plus --audio-driver Dummy -- $(CURDIR)/out/landscape/game.png
	convert out/landscape/game.png -resize 640x +dither -colors 128 -define png:compression-level=9 docs/guide/game.png
	$(MAKE) test-godot
	convert out/godot/forest.png -resize 60% +dither -colors 96 -define png:compression-level=9 docs/engines/godot_forest.png
endif

.PHONY: lint
lint: .venv/.blender .venv/.lint ## check formatting, lints and types of all sources
	@tools/prerequisites.sh rust lint
	cargo fmt --all --check
	cargo clippy $(CHECKED) --workspace --all-targets -- --deny warnings
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	.venv/bin/mypy

.PHONY: deny
deny: ## check all crates: licenses, duplicates, sources, known faults; needs cargo-deny (docs/supply_chain.md)
	@tools/deny.sh

.PHONY: licenses
licenses: ## write THIRD_PARTY_LICENSES.txt: the licenses of all that the wheel holds
	@tools/prerequisites.sh rust python
	@$$(tools/prerequisites.sh --find-python) tools/third_party.py

.PHONY: sbom
sbom: .venv-supply/.installed ## write dist/leafcloud.cdx.json, the bill of materials (CycloneDX) of all that is shipped
	@tools/prerequisites.sh rust
	.venv-supply/bin/python tools/sbom.py

.PHONY: locks
locks: .venv-supply/.installed ## lock the Python packages of tools/requirements (ARGS=--upgrade takes newer versions)
	tools/lock.sh $(CURDIR)/.venv-supply/bin/uv $(ARGS)

.PHONY: extension
extension: setup ## build the Blender extension's zip into dist/
	.venv/bin/python tools/build_extension.py --wheel $(WHEELS)/leafcloud-*.whl --out dist

.PHONY: extension-portable
extension-portable: setup .venv/.portable ## build the zip for all Linux systems that Blender supports (glibc 2.28), into dist/portable/
	rm -rf target/portable
	PATH="$(CURDIR)/.venv/bin:$$PATH" CARGO_TARGET_DIR=target/zig .venv/bin/maturin build --release --locked --zig --compatibility manylinux_2_28 --interpreter .venv/bin/python --out target/portable
	.venv/bin/python tools/build_extension.py --wheel target/portable/leafcloud-*.whl --out dist/portable

# BLENDER is a command, such as /opt/blender/blender.
.PHONY: test-interface
test-interface: extension .venv/.test ## drive the extension's zip in a real Blender's window: make test-interface BLENDER=/path/to/blender
	@tools/prerequisites.sh window
	@test -n "$$BLENDER" || { echo "leafcloud: make test-interface needs BLENDER, the command of a Blender 4.2 or later; tools/debian_blender.sh makes one" >&2; exit 1; }
	.venv/bin/python -m pytest tests/interface $(ARGS)

.PHONY: test-godot
test-godot: setup .venv/.test ## import baked trees into a real Godot: make test-godot GODOT='command of Godot 4.6'
	@tools/prerequisites.sh window
	@test -n "$$GODOT" || { echo "leafcloud: make test-godot needs GODOT, the command of a Godot 4.6; Debian sid has the package godot" >&2; exit 1; }
	.venv/bin/python -m pytest tests/godot --capture=no $(ARGS)

# Bevy takes some minutes to build. Pictures are drawn by Mesa's software Vulkan if there is one, else by the graphics card.
BEVY_TARGET = $(CURDIR)/target/bevy
BEVY_CARGO = CARGO_TARGET_DIR=$(BEVY_TARGET) cargo
SOFTWARE_VULKAN = $(firstword $(wildcard /usr/share/vulkan/icd.d/lvp_icd*.json))

.PHONY: test-bevy
test-bevy: setup .venv/.test ## build the plugin for Bevy, and draw baked trees with it
	cd engines/bevy && cargo fmt --check
	cd engines/bevy && $(BEVY_CARGO) clippy --locked --all-targets -- --deny warnings
	cd engines/bevy && $(BEVY_CARGO) test --locked
	cd engines/bevy && $(BEVY_CARGO) build --locked --example pictures
	$(if $(SOFTWARE_VULKAN),VK_DRIVER_FILES=$(SOFTWARE_VULKAN)) BEVY_PICTURES=$(BEVY_TARGET)/debug/examples/pictures \
		.venv/bin/python -m pytest tests/bevy --capture=no $(ARGS)

.PHONY: clean
clean: ## remove all build outputs and environments
	rm -rf .venv .venv-4.2 .venv-5.0 .venv-supply target dist out $(dir $(NODE_MODULES)) .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Rules of one environment. $(1): its folder, $(2): its Blender version
define environment
$(1)/.blender: tools/requirements/blender-$(2).txt
	@tools/prerequisites.sh rust python blender
	@tools/environment.sh $(1) $$<
	@touch $$@

$(1)/.test: tools/requirements/test.txt $(1)/.blender
	@tools/environment.sh $(1) $$<
	@touch $$@
endef
$(eval $(call environment,.venv,4.5))
$(eval $(call environment,.venv-4.2,4.2))
$(eval $(call environment,.venv-5.0,5.0))

.venv/.batch: tools/requirements/batch.txt .venv/.blender
	@tools/environment.sh .venv $<
	@touch $@

.venv/.build: tools/requirements/build.txt .venv/.blender
	@tools/environment.sh .venv $<
	@touch $@

.venv/.fidelity: tools/requirements/fidelity.txt .venv/.blender
	@tools/environment.sh .venv $<
	@touch $@

.venv/.lint: tools/requirements/lint.txt .venv/.blender
	@tools/environment.sh .venv $<
	@touch $@

# Apart from .venv, and without Blender.
.venv-supply/.installed: tools/requirements/supply.txt
	@tools/prerequisites.sh python
	@tools/environment.sh .venv-supply $<
	@touch $@

.venv/.portable: tools/requirements/portable.txt .venv/.build
	@tools/environment.sh .venv $<
	@touch $@

.venv/.wheel: $(WHEELS)/.built .venv/.blender
	@.venv/$(PIP_INSTALL) --force-reinstall --no-deps $(WHEELS)/leafcloud-*.whl
	@.venv/bin/python -c "import bpy, leafcloud"
	@touch $@

$(WHEELS)/.built: $(RUST_SOURCES) .venv/.build
	@rm -f $(WHEELS)/leafcloud-*.whl
	.venv/bin/maturin build --release --interpreter .venv/bin/python --out $(WHEELS)
	@touch $@

# Beside the environments, whose wheel is the fastest one: tools/run_tests.sh takes the core from here.
$(CORE)/.installed: $(RUST_SOURCES) .venv/.build
	@rm -rf $(CORE) target/checked
	tools/phase.sh "compile the core" .venv/bin/maturin build --locked --interpreter .venv/bin/python --out target/checked
	@.venv/$(PIP_INSTALL) --no-deps --target $(CORE) target/checked/leafcloud-*.whl
	@touch $@

# The tests of Rust run again when something that they read has changed.
target/.rust-tested: $(RUST_SOURCES) $(wildcard examples/*.glb) .venv/.blender
	tools/phase.sh "Rust's tests" cargo test --workspace --tests $(CHECKED)
	@touch $@

# npm writes this target itself.
%/node_modules/.package-lock.json: %/package-lock.json
	@tools/prerequisites.sh node
	@npm ci --prefix $* --no-audit --no-fund --silent
	@touch $@
