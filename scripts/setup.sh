#!/bin/sh
# setup.sh - sees to it that the build has what it needs: NASM 2.15 or newer, a C compiler, the C library's headers; and
# called with the word mpi, what the program rayo-mpi needs too: Open MPI with its headers, and libclang.
#
# Silent where all is there. What is missing comes from the machine's package manager: as root, or else with sudo. Where
# neither is to be had, Debian's and Ubuntu's NASM is unpacked into target/tools without any rights, and for anything else
# the script says what to install, and fails. A NASM that is not the first on PATH, unpacked or found elsewhere, is left
# as target/tools/usr/bin/nasm, where the Makefile looks for it. CARGO_TARGET_DIR, where it is set, is that target; NASM and
# CC are taken at their word.
set -eu
cd "$(dirname "$0")/.."

wanted=${1:-}
tools=${CARGO_TARGET_DIR:-target}/tools
local_nasm=$tools/usr/bin/nasm
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

say() { printf '%s\n' "$*" >&2; }
fail() { say "error: $*"; exit 1; }
have() { command -v "$1" >/dev/null 2>&1; }

# Whether $1 is a NASM of version 2.15 or newer. "NASM version 2.16.01 compiled on ..." and "2.15rc12" are versions.
nasm_will_do() {
    version=$("$1" -v 2>/dev/null | sed -n 's/^NASM version \([0-9]*\)\.\([0-9]*\).*/\1 \2/p')
    # shellcheck disable=SC2086 # two numbers, or none
    set -- $version
    [ $# -eq 2 ] && { [ "$1" -gt 2 ] || { [ "$1" -eq 2 ] && [ "$2" -ge 15 ]; }; }
}

# Whether the build will find a NASM; one that an older one on PATH hides is linked to where the Makefile looks.
find_nasm() {
    if [ -n "${NASM:-}" ]; then
        nasm_will_do "$NASM" || fail "the variable NASM names $NASM, which is not a NASM of version 2.15 or newer"
        return 0
    fi
    if nasm_will_do nasm || nasm_will_do "$local_nasm"; then return 0; fi
    for hidden in /usr/bin/nasm /usr/local/bin/nasm /opt/homebrew/bin/nasm; do
        if nasm_will_do "$hidden"; then
            mkdir -p "$(dirname "$local_nasm")"
            ln -sf "$hidden" "$local_nasm"
            return 0
        fi
    done
    return 1
}

# Whether $1 makes a program of C that uses the headers of the C library. It may be a compiler with flags.
compiles() {
    printf '#include <math.h>\n#include <stdint.h>\nint main(void) { return 0; }\n' >"$scratch/probe.c"
    # shellcheck disable=SC2086
    $1 -o "$scratch/probe" "$scratch/probe.c" >/dev/null 2>&1
}

# Whether the build will find a C compiler. rustc links with cc whatever CC says.
find_cc() {
    if [ -n "${CC:-}" ]; then
        compiles "$CC" || fail "the variable CC names $CC, which does not compile a C program"
    fi
    compiles cc
}

# Whether the build will find MPI's compiler and starter, and the library that reads its headers.
find_mpi() {
    have mpicc && have mpirun || return 1
    [ -z "${LIBCLANG_PATH:-}" ] || return 0
    for found in /usr/lib/llvm-*/lib/libclang*.so* /usr/lib/*/libclang*.so* /usr/lib/libclang*.so* /usr/lib64/libclang*.so* \
        /opt/homebrew/opt/llvm/lib/libclang.dylib; do
        [ ! -e "$found" ] || return 0
    done
    return 1
}

# What is still missing: the words nasm, cc and mpi.
missing() {
    # Kernels are for x86-64 alone; elsewhere the build is Rust, which needs no NASM.
    case $(uname -m) in
        x86_64 | amd64) find_nasm || printf 'nasm ' ;;
    esac
    find_cc || printf 'cc '
    [ "$wanted" != mpi ] || find_mpi || printf 'mpi '
}

# The package manager of this machine, or nothing.
manager() {
    for name in apt-get dnf pacman zypper apk brew; do
        if have "$name"; then echo "$name"; return; fi
    done
}

# The command that installs $2 and what follows, as the package manager $1 has it: one line to run, or to show.
install_command() {
    with=$1
    shift
    names=
    for need in "$@"; do
        case $with:$need in
            *:nasm) names="$names nasm" ;;
            apt-get:cc) names="$names gcc libc6-dev" ;;
            dnf:cc | zypper:cc) names="$names gcc glibc-devel" ;;
            pacman:cc) names="$names gcc" ;;
            apk:cc) names="$names gcc musl-dev" ;;
            brew:cc) ;; # see advise
            apt-get:mpi) names="$names libopenmpi-dev openmpi-bin libclang-dev" ;;
            dnf:mpi) names="$names openmpi-devel clang-devel" ;;
            pacman:mpi) names="$names openmpi clang" ;;
            zypper:mpi) names="$names openmpi4-devel clang-devel" ;;
            apk:mpi) names="$names openmpi-dev clang-dev" ;;
            brew:mpi) names="$names open-mpi llvm" ;;
        esac
    done
    [ -n "$names" ] || return 0
    case $with in
        apt-get) echo "apt-get install -y --no-install-recommends$names" ;;
        dnf) echo "dnf install -y$names" ;;
        pacman) echo "pacman -S --needed --noconfirm$names" ;;
        zypper) echo "zypper --non-interactive install$names" ;;
        apk) echo "apk add$names" ;;
        brew) echo "brew install$names" ;;
    esac
}

# The command that fetches the lists of packages.
update_command() {
    case $1 in
        apt-get) echo "apt-get update" ;;
        dnf) echo "dnf makecache" ;;
        pacman) echo "pacman -Sy --noconfirm" ;;
        zypper) echo "zypper --non-interactive refresh" ;;
        apk) echo "apk update" ;;
        brew) echo "brew update" ;;
    esac
}

# Runs a command line with the rights to install: as it is for root and for brew, which refuses root; else with sudo,
# where there is one that needs no password or a terminal to ask for it. Installers talk to standard error.
privileged() {
    if [ "$(id -u)" -eq 0 ] || [ "$with" = brew ]; then
        sudo=
    elif have sudo && { sudo -n true 2>/dev/null || [ -t 0 ]; }; then
        sudo=sudo
    else
        return 1
    fi
    say "+ $sudo${sudo:+ }$1"
    # shellcheck disable=SC2086 # a command line
    $sudo env DEBIAN_FRONTEND=noninteractive $1 >&2
}

# Lists that are not there, as in a fresh container, or older than what the servers still have, fail the first attempt.
install() {
    with=$(manager)
    [ -n "$with" ] || return 1
    command=$(install_command "$with" "$@")
    [ -n "$command" ] || return 1
    privileged "$command" || { privileged "$(update_command "$with")" && privileged "$command"; }
}

# Debian and Ubuntu without rights: the package is fetched and unpacked where we may write. Lists of our own, where the
# machine's do not do.
unpack_nasm() {
    have apt-get && have dpkg-deb || return 1
    say "Nothing could be installed: unpacking NASM into $tools instead."
    own="-o Dir::State::Lists=$scratch/lists -o Dir::Cache=$scratch/cache"
    mkdir -p "$scratch/lists/partial" "$scratch/cache/archives/partial" "$tools"
    (
        cd "$scratch"
        # shellcheck disable=SC2086
        apt-get download nasm >&2 || { apt-get $own update >&2 && apt-get $own download nasm >&2; }
    ) || return 1
    rm -f "$local_nasm"
    dpkg-deb -x "$scratch"/nasm_*.deb "$tools"
}

# What to do by hand, for each package manager or for the one that is here.
advise() {
    say "error: the build still lacks: $*"
    nasm_found=$(nasm -v 2>/dev/null | sed -n '1s/ compiled.*//p') || true
    case " $* " in
        *" nasm "*)
            say "  nasm: NASM 2.15 or newer${nasm_found:+ (on PATH: $nasm_found)}; nasm.us has its source, NASM=... can name it"
            ;;
    esac
    case " $* " in
        *" cc "*) say "  cc:   a C compiler that links, and the C library's headers; on macOS: xcode-select --install" ;;
    esac
    case " $* " in
        *" mpi "*) say "  mpi:  Open MPI with mpicc and mpirun on PATH, and libclang (LIBCLANG_PATH names its directory)" ;;
    esac
    say "Install it with root's rights and run make again:"
    with=$(manager)
    for name in ${with:-apt-get dnf pacman zypper apk brew}; do
        command=$(install_command "$name" "$@")
        [ -z "$command" ] || say "  $command"
    done
    # rustc needs cc to link.
    [ "$*" != nasm ] || say "Or build without it: cargo build --release --no-default-features --features c"
    exit 1
}

if ! have cargo; then
    if [ -x "$HOME/.cargo/bin/cargo" ]; then
        fail "cargo is not on PATH, but in ~/.cargo/bin: run . ~/.cargo/env, or open a new shell"
    fi
    fail "Rust is missing: install it with rustup (https://rustup.rs), open a new shell, and run make again"
fi

needs=$(missing)
[ -n "$needs" ] || exit 0
say "The build lacks: $needs"
# shellcheck disable=SC2086 # words
install $needs || true
needs=$(missing)
# Unpacked only where that is enough.
case $needs in
    "nasm ")
        unpack_nasm || true
        needs=$(missing)
        ;;
esac
# shellcheck disable=SC2086
[ -z "$needs" ] || advise $needs
