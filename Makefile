# Makefile - the commands of the README, `make demo` and `make test`, and those for working on the code; `make` lists them.

.DEFAULT_GOAL := help
.PHONY: help setup build release mpi demo install uninstall test test-all test-mpi view test-view toolchains elsewhere bench images counts accuracy stability leaving-out complexity map clean

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

# The folders of this machine, and what is written in their place where a panic or a symbol names a source file. A user's own
# RUSTFLAGS come before these flags, which the last line would notice.
release: setup ## Build the program to be given to others: it names no folder of this machine
	@cargo_home=$${CARGO_HOME:-$$HOME/.cargo} sysroot=$$(rustc --print sysroot) here=$$(pwd -P) flags=; \
	for pair in "$$cargo_home=cargo" "$$sysroot=rust" "$$here=rayo"; do flags="$$flags'''--remap-path-prefix=$$pair''',"; done; \
	$(cargo) --config "build.rustflags=[$$flags]" build --release --locked && \
	for folder in "$$cargo_home" "$$sysroot" "$$here"; do \
	    ! grep -qaF "$$folder" $(rayo) || { echo "error: $(rayo) names $$folder" >&2; exit 1; }; \
	done

mpi: ## Install what several processes need (Open MPI, libclang), and build rayo-mpi
	@scripts/setup.sh mpi
	$(cargo) build --release --locked --package rayo-mpi

# Where there is no program yet, an example of the library comes first, unoptimised: its kernels are in assembly, and the
# program takes four times as long to build. NASM frees so much that glibc's fast bins cost a fifth of its time. The example is
# compiled without Cargo, which for any example builds what tests and benches need: a third more.
first := CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=0 GLIBC_TUNABLES=glibc.malloc.mxfast=0
first_build = $(cargo) build --locked -p rayo --lib --no-default-features --features asm,files
first_link = $(or $(RUSTC),rustc) --edition 2024 --extern rayo="$(target)/debug/librayo.rlib" -L "$(target)/debug/deps"
demo: setup ## Show a picture, render two scenes on several engines, compare, and make a page of all experiments
	@test -x $(rayo) || { $(first) $(first_build) && $(first_link) -o "$(target)/debug/scene_to_png" examples/scene_to_png.rs; }
	@rayo=$(rayo) example="$(target)/debug/scene_to_png" out="$(OUT)/demo" scripts/demo.sh first
	$(cargo) build --release --locked
	@rayo=$(rayo) out="$(OUT)/demo" scripts/demo.sh

install: ## Install the program that `make build` made, its manual and completions: PREFIX=/usr/local, DESTDIR=
	@rayo=$(rayo) scripts/install.sh install "$(DESTDIR)" "$(PREFIX)"

uninstall: ## Take away what `make install` installed
	@scripts/install.sh uninstall "$(DESTDIR)" "$(PREFIX)"

# What tests could not be run here, a line each.
not_run := $(target)/not-run

# The packages that are built and tested by default: those of ranks and of windows need more than a compiler.
packages := -p rayo -p rayo-lab -p rayo-cli
tests := test --release --locked $(packages)
# Unit tests are in the crates themselves, which are compiled once more for them: unoptimised, at half of the cost.
unoptimised := $(foreach name,rayo rayo-lab rayo-cli,--config 'profile.release.package.$(name).opt-level=0')

test: setup ## Run what must pass: format, lints, tests, documentation
	$(cargo) fmt --check
	$(cargo) clippy --release --locked $(packages) --all-targets -- -D warnings
	@rm -f "$(not_run)"
	RAYO_NOT_RUN="$(not_run)" $(cargo) $(tests) --lib --bins $(unoptimised)
	RAYO_NOT_RUN="$(not_run)" $(cargo) $(tests) --test '*' --examples
	$(cargo) $(tests) --doc
	RUSTDOCFLAGS='-D warnings' $(cargo) doc --release --locked --no-deps $(packages)
	@[ ! -f "$(not_run)" ] || sort -u "$(not_run)"

test-all: export RAYO_ALL = 1
test-all: test ## The same with every case of the slow tests, of which `make test` takes a sample, and with other features
	for features in '' asm; do \
	    $(cargo) clippy --release --locked -p rayo --all-targets --no-default-features --features "$$features" -- -D warnings || exit; \
	done
	$(cargo) clippy --release --locked -p rayo-lab -p rayo-cli --all-targets --no-default-features -- -D warnings
	$(cargo) test --release --locked -p rayo-lab -p rayo-cli --no-default-features --test pictures --test commands

test-mpi: mpi ## Run the lints and the tests of what several processes do
	$(cargo) clippy --release --locked --package rayo-mpi --all-targets -- -D warnings
	$(cargo) test --release --locked --package rayo-mpi

# The window is a package of its own, with dependencies that nothing else here has: no other command builds it.
of_view := --release --locked --package rayo-view
SCENE ?= scenes/island.toml
view: setup ## Build rayo-view and show a scene in a window: SCENE=scenes/island.toml
	$(cargo) build $(of_view)
	"$(target)/release/rayo-view" "$(SCENE)"

test-view: setup ## Run the lints and the tests of the window, on a virtual display if there are Xvfb and xdotool
	$(cargo) clippy $(of_view) --all-targets -- -D warnings
	@rm -f "$(not_run)"
	RAYO_NOT_RUN="$(not_run)" $(cargo) test $(of_view)
	@[ ! -f "$(not_run)" ] || sort -u "$(not_run)"

toolchains: build ## Build with every NASM and C compiler of Debian's suites, and run on the CPUs that qemu-user plays
	@$(if $(NASM),,$(unpacked_nasm)) scripts/toolchains.sh $(strict)

elsewhere: build ## Build for Windows and for Linux on ARM, and hold the pictures of Wine and qemu-user against this machine's
	@$(if $(NASM),,$(unpacked_nasm)) scripts/elsewhere.sh $(strict)

bench: setup ## Run the micro benches
	$(cargo) bench --locked -p rayo

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
	@git ls-files '*.asm' '*.inc' '*.c' '*.h' '*.rs' | while read -r file; do \
	    printf '%-40s %s\n' "$$file" "$$(sed -n '1{s|^//! ||;s|^/\* [^ ]* - ||;s|^; [^ ]* - ||;s| \*/$$||;p;}' "$$file")"; \
	done

clean: ## Remove everything that was built or rendered
	rm -rf "$(target)" "$(OUT)"
