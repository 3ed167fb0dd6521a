# Makefile - the commands of the README, `make demo` and `make test`, and those for working on the code; `make` lists them.

.DEFAULT_GOAL := help
.PHONY: help setup build mpi demo install uninstall test test-all test-mpi toolchains elsewhere bench images counts accuracy stability leaving-out complexity map clean

# Where everything that is built and rendered goes: here, or where CARGO_TARGET_DIR says, so that this folder may be read-only.
target := $(abspath $(or $(CARGO_TARGET_DIR),target))
OUT ?= $(if $(CARGO_TARGET_DIR),$(target)/)out

# cargo, with the NASM that set-up had to put under target/tools, if it had to. Expanded when a recipe starts, which is
# after set-up. A NASM named by the user stays.
unpacked_nasm = $(shell test -x "$(target)/tools/usr/bin/nasm" && echo NASM='"$(target)/tools/usr/bin/nasm"')
cargo = $(strip $(if $(NASM),,$(unpacked_nasm)) cargo)

# The program that `make build` makes.
rayo := "$(target)/release/rayo"

# Where `make install` puts it.
PREFIX ?= /usr/local

# Scenes that the README shows.
shown := knot.in planet.in sunflower.in island.toml chain.toml
# Scenes of which docs/leaving-out.md tells what leaving out is worth.
planned := sphere.in tetrahedron.in two-lights.in many.in island.toml

help: ## List the commands
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1|\2/p' Makefile | awk -F'|' '{ printf "%-12s %s\n", $$1, $$2 }'

setup: ## Install what the build needs and this machine lacks
	@scripts/setup.sh

build: setup ## Build the program, target/release/rayo, or under CARGO_TARGET_DIR if that is set
	$(cargo) build --release --locked

mpi: ## Install what several processes need (Open MPI, libclang), and build the program with it
	@scripts/setup.sh mpi
	$(cargo) build --release --locked --features mpi

# Where there is no program yet, one that renders and does no more comes first, unoptimised: its kernels are in assembly, and
# the other takes four times as long. NASM frees so much that glibc's fast bins cost a fifth of its time.
first := CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=0 GLIBC_TUNABLES=glibc.malloc.mxfast=0
demo: setup ## Show a picture, render two scenes on several engines, compare, and make a page of all experiments
	@test -x $(rayo) || $(first) $(cargo) build --locked --no-default-features --features asm,render
	@rayo=$$(ls $(rayo) "$(target)/debug/rayo" 2>/dev/null | head -n 1) out="$(OUT)/demo" scripts/demo.sh first
	$(cargo) build --release --locked
	@rayo=$(rayo) out="$(OUT)/demo" scripts/demo.sh

install: ## Install the program that `make build` made, its manual and completions: PREFIX=/usr/local, DESTDIR=
	@rayo=$(rayo) scripts/install.sh install "$(DESTDIR)" "$(PREFIX)"

uninstall: ## Take away what `make install` installed
	@scripts/install.sh uninstall "$(DESTDIR)" "$(PREFIX)"

# What tests could not be run here, a line each.
not_run := $(target)/not-run

test: setup ## Run what must pass: format, lints, tests, documentation
	$(cargo) fmt --check
	$(cargo) clippy --release --locked --all-targets -- -D warnings
	@rm -f "$(not_run)"
	RAYO_NOT_RUN="$(not_run)" $(cargo) test --release --locked
	RUSTDOCFLAGS='-D warnings' $(cargo) doc --release --locked --no-deps
	@[ ! -f "$(not_run)" ] || sort -u "$(not_run)"

test-all: export RAYO_ALL = 1
test-all: test ## The same with every case of the slow tests, of which `make test` takes a sample, and with other features
	for features in '' asm cli; do \
	    $(cargo) clippy --release --locked --all-targets --no-default-features --features "$$features" -- -D warnings || exit; \
	done
	$(cargo) test --release --locked --no-default-features --features cli --test pictures --test commands --test repository

test-mpi: mpi ## Run the lints and the tests of what several processes do
	$(cargo) clippy --release --locked --all-targets --features mpi -- -D warnings
	$(cargo) test --release --locked --features mpi --lib --test mpi

toolchains: build ## Build with every NASM and C compiler of Debian's suites, and run on the CPUs that qemu-user plays
	@$(if $(NASM),,$(unpacked_nasm)) scripts/toolchains.sh $(strict)

elsewhere: build ## Build for Windows and for Linux on ARM, and hold the pictures of Wine and qemu-user against this machine's
	@$(if $(NASM),,$(unpacked_nasm)) scripts/elsewhere.sh $(strict)

bench: setup ## Run the micro benches
	$(cargo) bench --locked

images: build ## Make the pictures and figures of the README anew
	for scene in $(shown); do \
	    $(rayo) render scenes/$$scene --shadows --size 400x300 --samples 4 --srgb -o docs/images/$${scene%.*}.png || exit; \
	done
	$(rayo) experiment --ladder --out "$(OUT)"/experiment
	cp "$(OUT)"/experiment/ratio.svg "$(OUT)"/experiment/ladder.svg docs/images/

counts: build ## Count and time the operations anew: docs/results/instruction-counts.md and its figure
	mkdir -p "$(OUT)"
	$(rayo) ops --executed --markdown --figure docs/results/instruction-counts.svg >"$(OUT)"/instruction-counts.md
	cp "$(OUT)"/instruction-counts.md docs/results/

accuracy: build ## Measure error against run time anew: docs/results/accuracy.md and its figure
	$(rayo) accuracy --out "$(OUT)"/accuracy
	cp "$(OUT)"/accuracy/accuracy.md "$(OUT)"/accuracy/accuracy.svg docs/results/

stability: build ## Sweep the stiff scenes anew: docs/results/stability.md and its figure
	$(rayo) stability --out "$(OUT)"/stability
	cp "$(OUT)"/stability/stability.md "$(OUT)"/stability/stability.svg docs/results/

leaving-out: build ## Measure what each omission is worth anew: docs/results/leaving-out.txt and its figure
	mkdir -p "$(OUT)"
	$(rayo) plan $(planned:%=scenes/%) --measure --figure docs/results/leaving-out.svg >"$(OUT)"/leaving-out.txt
	cp "$(OUT)"/leaving-out.txt docs/results/

complexity: build ## Measure large pictures and scenes anew: docs/results/complexity.md and its figure
	$(rayo) experiment --complexity --out "$(OUT)"/complexity
	cp "$(OUT)"/complexity/complexity.md "$(OUT)"/complexity/complexity.svg docs/results/

map: ## Print the first line of every source file: what lives there
	@git ls-files asm benches build build.rs examples src tests | while read -r file; do \
	    printf '%-40s %s\n' "$$file" "$$(sed -n '1{s|^//! ||;s|^/\* [^ ]* - ||;s|^; [^ ]* - ||;s| \*/$$||;p;}' "$$file")"; \
	done

clean: ## Remove everything that was built or rendered
	rm -rf "$(target)" "$(OUT)"
