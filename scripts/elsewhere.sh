#!/bin/sh
# elsewhere.sh - builds the program for Windows and for Linux on ARM, and holds its pictures against this machine's; for
# make elsewhere.
#
# It needs Rust's library for each, which rustup adds, a C compiler for each, and what plays it: Wine, or qemu-user. It says what
# it lacks, and how to get that; with --strict this is an error.
set -eu
cd "$(dirname "$0")/.."

strict=${1:-}
target=${CARGO_TARGET_DIR:-target}
rayo=$target/release/rayo
lacking=
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
export WINEPREFIX="$scratch/wine" WINEDEBUG=-all
# What is built here makes few small pictures: unoptimised.
export CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=0

say() { printf '%s\n' "$*"; }
fail() { say "error: $*" >&2; exit 1; }

# Whether all is there for $1; else says what to install: a package for each program that is named after it, as program:package.
ready() {
    triple=$1
    shift
    wanted=
    for need in "$@"; do
        command -v "${need%:*}" >/dev/null || wanted="$wanted ${need#*:}"
    done
    if [ -z "$wanted" ] && [ ! -d "$(rustc --print sysroot)/lib/rustlib/$triple" ]; then
        rustup target add "$triple" || wanted=" Rust's library for $triple: rustup target add $triple"
    fi
    [ -z "$wanted" ] || { lacking="$lacking
  $triple: could not get$wanted"; return 1; }
}

# Holds the pictures of all engines of the program that "$@" starts against those of this machine's.
pictures() {
    [ -x "$rayo" ] || cargo build --release --locked
    engines=$("$@" info | tr -d '\r' | sed -n 's/^engines *//p' | tr -d ,)
    [ -n "$engines" ] || fail "rayo info says nothing of engines: $*"
    for engine in $engines; do
        for scene in sphere tetrahedron two-lights many; do
            "$@" render "scenes/$scene.in" --size 96x64 --engine "$engine" --quiet -o "$scratch/there.png"
            "$rayo" render "scenes/$scene.in" --size 96x64 --engine "$engine" --quiet -o "$scratch/here.png"
            # NEON adds what it multiplies in an order of its own, and rounds both once.
            case $1-$engine in
                play_arm-rust | play_arm-portable) "$rayo" diff --tolerance 1 "$scratch/there.png" "$scratch/here.png" >/dev/null ;;
                *) cmp "$scratch/there.png" "$scratch/here.png" ;;
            esac || fail "scenes/$scene.in by $engine is another picture: $*"
        done
    done
    say "  the same pictures by: $engines"
}

say "Windows, by mingw-w64 and Wine:"
if ready x86_64-pc-windows-gnu x86_64-w64-mingw32-gcc:gcc-mingw-w64-x86-64 wine:wine64; then
    cargo build --locked --target x86_64-pc-windows-gnu
    # Rust asks a library for random numbers that older Wines lack, as 8.0; beside the program it is found.
    echo '__declspec(dllexport) int ProcessPrng(void *to, unsigned long long length) { return RtlGenRandom(to, length); }' |
        x86_64-w64-mingw32-gcc -shared -o "$target/x86_64-pc-windows-gnu/debug/bcryptprimitives.dll" -x c \
            -include windows.h -include ntsecapi.h - -ladvapi32
    play() { wine "$target/x86_64-pc-windows-gnu/debug/rayo.exe" "$@"; }
    pictures play
    # The instructions of an operation, by each engine in assembly, are those that are counted here, where they have their
    # sources beside them.
    for engine in paper sse41 avx2 avx512; do
        play ops --op dot --engine "$engine" --asm | tr -d '\r' >"$scratch/there"
        "$rayo" ops --op dot --engine "$engine" --asm | sed 's/  *[a-z0-9_]*\.\(asm\|inc\):.*//' |
            cmp - "$scratch/there" || fail "rayo ops counts otherwise by $engine"
    done
    play step scenes/sphere.in 2>"$scratch/said" && fail "rayo step watches where it cannot"
    grep -q 'single-stepping is written for Linux on x86-64' "$scratch/said" || { cat "$scratch/said"; fail "rayo step does not say why"; }
    say "  the same counts, and rayo step says that it needs Linux"
fi

say "Linux on ARM, by qemu-user:"
if ready aarch64-unknown-linux-gnu aarch64-linux-gnu-gcc:gcc-aarch64-linux-gnu qemu-aarch64:qemu-user; then
    export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc QEMU_LD_PREFIX=/usr/aarch64-linux-gnu
    export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER=qemu-aarch64
    cargo build --release --locked --target aarch64-unknown-linux-gnu
    play_arm() { qemu-aarch64 "$target/aarch64-unknown-linux-gnu/release/rayo" "$@"; }
    pictures play_arm
    RAYO_RUNNER=qemu-aarch64 cargo test --release --locked --target aarch64-unknown-linux-gnu -p rayo-lab --test pictures
fi

[ -z "$lacking" ] || { say "Not tried:$lacking"; [ "$strict" != --strict ] || fail "with --strict nothing may be missing"; }
