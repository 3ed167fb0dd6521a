#!/bin/sh
# toolchains.sh - builds with the NASMs and C compilers that users have, and runs on the CPUs that they have; for make toolchains.
#
# They come from Debian's suites, each with its own libraries, into target/toolchains: nothing is installed, and apt's own
# lists stay as they are. DEBIAN names a mirror where this machine's apt has none. Every NASM assembles every unit for ELF,
# Win64 and Mach-O, and lab/tests/kernels/formats.rs holds all of that against the objects of the build; every compiler
# compiles the C with its rungs. Then qemu-user plays CPUs old and new, on which pictures must be those of this one.
#
# At the end it says what could not be had or tried; with --strict that is an error.
set -eu
cd "$(dirname "$0")/.."

strict=${1:-}
target=${CARGO_TARGET_DIR:-target}
case $target in /*) ;; *) target=$PWD/$target ;; esac
home=$target/toolchains
rayo=$target/release/rayo
lacking=

say() { printf '%s\n' "$*"; }
lacks() { say "  not tried: $*"; lacking="$lacking
  $*"; }
fail() { say "error: $*" >&2; exit 1; }

# The suites, and of each the NASM and the compilers wanted.
suites='bullseye bookworm trixie sid'
packages() {
    case $1 in
        bullseye) echo nasm=2.15.05 gcc-10 libc6-dev ;;
        bookworm) echo nasm=2.16.01 gcc-11 gcc-12 clang-14 ;;
        trixie) echo nasm=2.16.03 gcc-13 gcc-14 clang-19 ;;
        sid) echo nasm=3.01 gcc clang ;;
    esac
}

# apt-get for the suite $1, with lists, status and cache of its own.
suite_apt() {
    at=$home/$1
    shift
    apt-get -qq -o Dir::State="$at/apt" -o Dir::State::status="$at/apt/status" -o Dir::Cache="$at/apt" \
        -o Dir::Etc::SourceList="$at/apt/sources.list" -o Dir::Etc::SourceParts=/dev/null \
        -o Dir::Etc::Preferences=/dev/null -o Dir::Etc::PreferencesParts=/dev/null \
        -o APT::Architecture=amd64 -o APT::Architectures=amd64 -o APT::Install-Recommends=false \
        -o Acquire::Languages=none -o Acquire::Check-Valid-Until=false -o Acquire::IndexTargets::deb::DEP-11::DefaultEnabled=false \
        "$@"
}

# Fetches the packages $2 and on of the suite $1 with all that they need, and unpacks them into target/toolchains/$1/root.
unpack() {
    suite=$1
    at=$home/$suite
    shift
    mkdir -p "$at/apt/lists/partial" "$at/apt/archives/partial"
    : >"$at/apt/status"
    echo "deb [arch=amd64] $mirror $suite main" >"$at/apt/sources.list"
    suite_apt "$suite" update && suite_apt "$suite" install -y --download-only "$@" >/dev/null || return 1
    rm -rf "$at/root"
    for folder in bin lib lib64 sbin; do
        mkdir -p "$at/root/usr/$folder"
        ln -s "usr/$folder" "$at/root/$folder"
    done
    for package in "$at"/apt/archives/*.deb; do
        dpkg-deb --fsys-tarfile "$package" |
            tar -x -C "$at/root" --keep-directory-symlink --no-same-owner --exclude='./usr/share/*' --exclude='./etc/*' --exclude='./var/*' || return 1
    done
    rm -rf "$at/apt/archives"
    loader=$(find "$at/root/usr/lib" -name ld-linux-x86-64.so.2 -o -name 'ld-2.*.so' | head -n 1)
    # What is started by name or by a compiler.
    for program in "$at"/root/usr/bin/nasm "$at"/root/usr/bin/*-as "$at"/root/usr/bin/*-gcc-[0-9]* \
        "$at"/root/usr/lib*/gcc/*/*/cc1 "$at"/root/usr/lib/llvm-*/bin/clang; do
        [ ! -f "$program" ] || [ -h "$program" ] || wrap "$program"
    done
    touch "$at/unpacked"
}

# Has the program $1 run by its own suite's loader, with its own libraries, and compile with its own headers.
wrap() {
    mv "$1" "$1.elf"
    case $1 in
        */cc1) own= ;;
        *-gcc-*) own="--sysroot=$at/root -B$at/root/usr/bin" ;;
        */clang) own="--sysroot=$at/root -resource-dir $(echo "${1%/bin/clang}"/lib/clang/[0-9]*)" ;;
        *) own= ;;
    esac
    printf '#!/bin/sh\nexec %s --library-path %s %s %s "$@"\n' "$loader" \
        "$at/root/usr/lib/x86_64-linux-gnu:$at/root/usr/lib" "$1.elf" "$own" >"$1"
    chmod +x "$1"
}

# What makes a warning an error, for a NASM or for a build: not in sid, whose programs are other ones every day.
warnings() {
    case $1-$2 in
        sid-*) ;;
        *-nasm) echo -Wall -Werror ;;
        *) echo 1 ;;
    esac
}

# The compilers of the suite $1.
compilers() { find "$home/$1/root/usr/bin" -name 'gcc-[0-9]*[0-9]' -o -name 'clang-[0-9]*[0-9]' | sort; }

[ "$(uname -sm)" = 'Linux x86_64' ] || fail "this needs Linux on x86-64, of which its NASMs and compilers are"
command -v apt-get >/dev/null && command -v dpkg-deb >/dev/null || fail "this needs apt-get and dpkg-deb, which unpack Debian's packages"
mirror=${DEBIAN:-$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Label: Debian' | sort -u | head -n 1)}
[ -n "$mirror" ] || fail "apt knows no archive of Debian: name one in the variable DEBIAN"

say "Unpacking from Debian's suites into target/toolchains:"
for suite in $suites; do
    at=$home/$suite
    for package in $(packages "$suite"); do
        case $package in
            nasm=*) version=${package#nasm=} names=nasm ;;
            *) names="$names $package" ;;
        esac
    done
    # shellcheck disable=SC2086 # names
    if ! [ -e "$at/unpacked" ] && ! unpack "$suite" $names; then
        lacks "$names of Debian $suite could not be fetched"
        continue
    fi
    found=$("$at/root/usr/bin/nasm" -v | sed 's/^NASM version \([^ ]*\).*/\1/') || fail "the NASM of Debian $suite does not run"
    [ "$found" = "$version" ] || lacks "NASM $version: Debian $suite has $found in its place"
    list="NASM $found"
    for compiler in $(compilers "$suite"); do
        name=$(basename "$compiler")
        list="$list, ${name%-*} $("$compiler" -dumpfullversion 2>/dev/null || "$compiler" -dumpversion)"
    done
    say "  $suite: $list"
done

# Without these bins NASM takes a fifth less time.
export GLIBC_TUNABLES=glibc.malloc.mxfast=0
say "Assembling every unit for ELF, Win64 and Mach-O:"
rm -rf "$home/objects"
for suite in $suites; do
    [ -e "$home/$suite/unpacked" ] || continue
    for format in elf64 win64 macho64; do
        mkdir -p "$home/objects/$suite/$format"
        for unit in asm/*.asm; do
            name=$(basename "$unit" .asm)
            echo "$home/$suite/root/usr/bin/nasm -f $format -Iasm/ $(warnings "$suite" nasm) -o $home/objects/$suite/$format/$name.o $unit"
        done
    done
done | xargs -P "$(nproc)" -I {} sh -c '{} || { echo "failed: {}"; exit 255; }' || fail "a NASM refused a unit: see above"
RAYO_OBJECTS=$home/objects cargo test -q --release --locked -p rayo-lab --test kernels formats:: </dev/null

say "Building with every NASM, whose listing names the source of each instruction, and with every C compiler:"
for suite in $suites; do
    [ -e "$home/$suite/unpacked" ] || continue
    for compiler in $(compilers "$suite"); do
        RAYO_STRICT=$(warnings "$suite" build) NASM=$home/$suite/root/usr/bin/nasm CC=$compiler cargo check -q --locked -p rayo --lib --target-dir "$home/cargo" \
            --no-default-features --features asm,c,lab </dev/null || fail "$compiler and the NASM of Debian $suite do not build the library"
    done
done

say "Playing CPUs, on which the program must run, and give the pictures of this one:"
if command -v qemu-x86_64 >/dev/null; then
    [ -x "$rayo" ] || cargo build --release --locked
    for cpu in qemu64 core2duo Nehalem SandyBridge Haswell Haswell,-fma; do
        # In floats: levels of 255 may come of estimates of roots, which each CPU rounds as it likes.
        play() { qemu-x86_64 -cpu "$cpu" "$rayo" "$@" 2>"$home/qemu.log"; }
        engine=$(play info | sed -n 's/^auto *//p')
        [ -n "$engine" ] || { cat "$home/qemu.log"; fail "rayo info does not run on $cpu"; }
        for scene in sphere tetrahedron many; do
            play render "scenes/$scene.in" --size 96x64 --quiet -o "$home/played.pfm" || { cat "$home/qemu.log"; fail "scenes/$scene.in is not rendered on $cpu"; }
            "$rayo" render "scenes/$scene.in" --size 96x64 --engine "$engine" --quiet -o "$home/real.pfm"
            cmp "$home/played.pfm" "$home/real.pfm" || fail "scenes/$scene.in by $engine is another picture on $cpu"
        done
        say "  $cpu: $engine"
    done
else
    lacks "other CPUs than this one: qemu-x86_64 is not there; the package is qemu-user"
fi

[ -z "$lacking" ] || { say "Not tried:$lacking"; [ "$strict" != --strict ] || fail "with --strict nothing may be missing"; }
