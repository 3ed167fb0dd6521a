#!/bin/sh
# demo.sh - renders two scenes on several engines, checks that the pictures agree, and reports on all experiments; for make demo.
# Called with the word first, it renders one picture to show, and in a terminal shows it there if the program is built.
set -eu
cd "$(dirname "$0")/.."

: "${rayo:=target/release/rayo}"
: "${example:=target/debug/scene_to_png}"
: "${out:=out/demo}"

if [ "${1:-}" = first ]; then
    mkdir -p "$out"
    preview=
    [ ! -t 1 ] || preview=--preview
    # It is the one at the top of the README. Where the program is not built yet, an example of the library makes the same file.
    if [ -x "$rayo" ]; then
        # shellcheck disable=SC2086 # a flag, or none
        "$rayo" render scenes/island.toml --shadows --size 400x300 --samples 4 --srgb --quiet $preview -o "$out/island.png"
    else
        "$example" scenes/island.toml "$out/island.png" 400x300 >/dev/null
    fi
    printf '\nThe first picture: %s\n\n' "$out/island.png"
    exit
fi

# What `rayo info` tells under a name.
info() { "$rayo" info | sed -n "s/^$1 *//p"; }

# The paper's two, where this architecture has them, and the fastest engine.
fastest=$(info auto)
case ", $(info engines)," in
    *", c, paper,"*) pair='c paper' ;;
    *) pair= ;;
esac

mkdir -p "$out"
for scene in sphere tetrahedron; do
    for engine in reference $pair "$fastest"; do
        "$rayo" render "scenes/$scene.in" --engine "$engine" --quiet -o "$out/$scene-$engine.png"
    done
done

# One level of 255 is what f32 and f64 may differ by where they round a colour down on different sides of a level. An edge
# pixel that one engine hits and another misses would differ by more and end the demo: in these two scenes there is none.
agree() {
    verdict=$("$rayo" diff --tolerance 1 "$out/$1-$2.png" "$out/$1-$3.png") || {
        printf '%s: %s and %s do not agree:\n%s\n' "$1" "$2" "$3" "$verdict" >&2
        exit 1
    }
    printf '  %-12s %-21s %s\n' "$1" "$2 and $3" "$(printf '%s\n' "$verdict" | head -n 1)"
}

printf '\nThe engines agree, to one level of 255:\n'
for scene in sphere tetrahedron; do
    [ -z "$pair" ] || agree "$scene" c paper
    for engine in $pair "$fastest"; do agree "$scene" reference "$engine"; done
done

printf '\nThe pictures:\n'
printf '  %s\n' "$out"/*.png

if [ -n "$pair" ]; then
    printf "\nThe paper's claims on this machine, and the page of everything that was measured, to be opened in a browser:\n"
    "$rayo" report --quick --out "$out/report"
fi
