#!/bin/sh
# demo.sh - renders two scenes on three engines, checks that the pictures agree, and measures C against SIMD; for make demo.
set -eu
cd "$(dirname "$0")/.."

: "${rayo:=target/release/rayo}"
out=out/demo

# On another architecture than x86-64 the paper's two are not there, and the Rust engine stands in for them.
engines=$("$rayo" info | sed -n 's/^engines *//p')
case ", $engines," in
    *", c, paper"*) first=c second=paper ;;
    *) first=rust second= ;;
esac

mkdir -p "$out"
for scene in sphere tetrahedron; do
    for engine in reference $first $second; do
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
    printf '  %-12s %-20s %s\n' "$1" "$2 and $3" "$(printf '%s\n' "$verdict" | head -n 1)"
}

printf '\nThe engines agree, to one level of 255:\n'
for scene in sphere tetrahedron; do
    [ -z "$second" ] || agree "$scene" "$first" "$second"
    for engine in $first $second; do agree "$scene" reference "$engine"; done
done

if [ -n "$second" ]; then
    printf '\nThe C against the SIMD, on a small image:\n'
    "$rayo" experiment --engines c,paper --quick --out "$out/experiment"
fi

printf '\nThe pictures:\n'
printf '  %s\n' "$out"/*.png
