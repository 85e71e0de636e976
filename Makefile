# sizeup: what a developer or a curious visitor types. `make help` lists the targets.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: fuzz help deps deps-test deps-python deps-qgis deps-web deps-batch deps-onnxruntime deps-val3dity deps-citygml deps-networks deps-features networks demo test test-slow lint bench accuracy accuracy-footprints docs schemas qgis-plugin train-test deb wheel test-python test-packages clean

CARGO ?= cargo
DEMO_DIR ?= sizeup-demo
RUSTDOC_STRICT := -D warnings -A rustdoc::private_intra_doc_links

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-20s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

deps: ## Install what is missing to build and run (GDAL, PROJ, a C++ compiler, Rust)
	@tools/deps.sh build

deps-test: deps ## Install what is missing to test against independent tools
	@tools/deps.sh test

deps-python: ## Install trimesh, shapely and scipy into target/python, so that the measures are checked against them
	@tools/deps.sh python

deps-qgis: ## Install QGIS (200 MB), so that the tests that open results in it run too
	@tools/deps.sh qgis

deps-web: ## Install a browser and validators of glTF and 3D Tiles alone (170 MB to load); part of deps-test
	@tools/deps.sh web

deps-batch: ## Install Snakemake into target/batch, so that the tests that run cities through it run too
	@tools/deps.sh batch

deps-onnxruntime: ## Fetch ONNX Runtime's library into target/onnxruntime: faster, and for graphs the embedded engine cannot run
	@tools/deps.sh onnxruntime

deps-val3dity: ## Build val3dity, a validator of solids by others, from its source into target/tools (ten minutes)
	@tools/deps.sh val3dity

deps-citygml: ## Fetch the official schemas of CityGML 3.0 into target/tools, from the source of citygml4j
	@tools/deps.sh citygml

deps-networks: ## Install PyTorch and what exports the real architectures of depth networks, into target/networks
	@tools/deps.sh networks

deps-features: ## Install what computes the features of the paper's footprint network, SAM 3 and Depth Anything 3 (6 GB; no weights)
	@tools/deps.sh features

networks: deps-networks ## Export real architectures with random weights into target/networks/graphs, to try engines on
	target/networks/bin/python tools/export_depth_networks.py target/networks/graphs

demo: deps ## Build, simulate a small town, find its heights, and show the result
	@echo "Building the program: minutes the first time, seconds later. The demo itself follows and says where its first picture is."
	$(CARGO) build --release --locked
	target/release/sizeup demo --output $(DEMO_DIR)

test: deps-test ## Run all tests
	@rm -f "$${CARGO_TARGET_DIR:-target}/tmp/skipped.txt"
	$(CARGO) test --workspace --locked
	@tools/skipped.sh

# Others that are ignored measure, and print what they measured.
test-slow: deps-test ## Run the tests that take half a minute of a processor or more each and are not part of `make test`
	$(CARGO) test --locked --workspace --test it -- --ignored \
		--skip table_of_accuracy --skip a_million_contours --skip frames_per_second

# The training of footprint networks is a package of its own: the program builds and passes its tests without it. A continuous
# integration runs this beside `make test`, with the same cache of `target`.
train-test: deps ## Run the tests of training/ (footprint networks), and its lints; check that fuzz/ builds
	cd fuzz && CARGO_TARGET_DIR=$(CURDIR)/target $(CARGO) check --locked
	cd training && CARGO_TARGET_DIR=$(CURDIR)/target $(CARGO) fmt --check
	cd training && CARGO_TARGET_DIR=$(CURDIR)/target $(CARGO) clippy --release --locked --all-targets -- -D warnings
	cd training && CARGO_TARGET_DIR=$(CURDIR)/target $(CARGO) test --release --locked

lint: deps ## Check formatting, lints (with and without rare formats) and the documentation, warnings are errors
	$(CARGO) fmt --check
	$(CARGO) clippy --workspace --locked --all-targets -- -D warnings
	$(CARGO) clippy --locked -- -D warnings
	RUSTDOCFLAGS="$(RUSTDOC_STRICT)" $(CARGO) doc --workspace --locked --no-deps

bench: deps ## Run the benchmarks
	$(CARGO) bench --locked

fuzz: deps ## Feed every reader with damaged files for a minute, led by coverage
	fuzz/run.sh

accuracy: deps ## Measure the tables of docs/accuracy.md and write them there (an hour; real towns too with DATA=folder)
	$(CARGO) build --release --locked --workspace
	tools/accuracy.py measure target/release/sizeup target/accuracy $(DATA)
	tools/accuracy.py write target/accuracy

accuracy-footprints: deps ## Print the table of footprints from masks in docs/accuracy.md
	$(CARGO) test --locked --test it table_of_accuracy -- --ignored --nocapture

docs: ## Write docs/reference.md anew, and build the API documentation into target/doc
	@tools/deps.sh docs
	$(CARGO) build --release --locked --workspace
	tools/reference.py target/release/sizeup > docs/reference.md
	RUSTDOCFLAGS="$(RUSTDOC_STRICT)" $(CARGO) doc --workspace --locked --no-deps

schemas: deps ## Write schemas/ anew from the code
	$(CARGO) run --locked --release -- schema --output schemas
	$(CARGO) run --locked --release -p sizeup-lab -- schema --output schemas

qgis-plugin: ## Pack the QGIS plugin into target/sizeup-qgis-VERSION.zip
	@tools/qgis_plugin.sh

deb: deps ## Pack target/packages/sizeup_VERSION_ARCHITECTURE.deb for this Debian or Ubuntu
	@packaging/deb.sh

wheel: ## Build the Python wheel that brings the program with GDAL and PROJ (long the first time)
	@tools/deps.sh wheel
	@packaging/wheel.sh

test-python: deps ## Build the Python package with this system's GDAL and PROJ, and run its tests and example
	@packaging/test_python.sh

test-packages: deb wheel ## Install both packages in a bare Debian, as root, and run the demo there; says times and sizes
	packaging/test_python.sh "$$(ls -t "$${CARGO_TARGET_DIR:-target}"/packages/sizeup-*manylinux*.whl | head -1)"
	packaging/bare_root.sh deb "$$(ls -t "$${CARGO_TARGET_DIR:-target}"/packages/sizeup_*.deb | head -1)"
	packaging/bare_root.sh wheel "$$(ls -t "$${CARGO_TARGET_DIR:-target}"/packages/sizeup-*manylinux*.whl | head -1)"

clean: ## Remove build output and the demo
	$(CARGO) clean
	rm -rf $(DEMO_DIR)
