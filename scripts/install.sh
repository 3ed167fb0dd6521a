#!/bin/sh
# install.sh - puts the program, its manual pages and its completions in place, or takes them away; for make install.
#
# Called as: rayo=PROGRAM install.sh install|uninstall DESTDIR PREFIX. Everything is made first in a folder of its own, and
# moved when all of it could be copied, so that nothing is left half installed.
set -eu
cd "$(dirname "$0")/.."

: "${rayo:=target/release/rayo}"
action=$1 prefix=$3 root=$2$3
fail() { printf 'error: %s\n' "$*" >&2; exit 1; }

case $prefix in
    /*) ;;
    *) fail "PREFIX must be an absolute path, and is '$prefix'" ;;
esac

# Who may not write to a folder, or make it, is told before anything is changed.
writable() {
    folder=$1
    while [ ! -e "$folder" ]; do folder=$(dirname "$folder"); done
    [ -d "$folder" ] && [ -w "$folder" ] && [ -x "$folder" ] ||
        fail "$folder cannot be written to: do it with root's rights, or name another place, as in make $action PREFIX=\$HOME/.local"
}

if [ "$action" = uninstall ]; then
    for file in "$root/bin/rayo" "$root"/share/man/man1/rayo.1 "$root"/share/man/man1/rayo-*.1 \
        "$root/share/bash-completion/completions/rayo" "$root/share/zsh/site-functions/_rayo" \
        "$root/share/fish/vendor_completions.d/rayo.fish"; do
        [ ! -e "$file" ] || { writable "$(dirname "$file")" && rm -f "$file"; }
    done
    exit
fi

[ -x "$rayo" ] || fail "there is no program at $rayo: run make build first"
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
mkdir -p "$stage/bin" "$stage/share/bash-completion/completions" "$stage/share/zsh/site-functions" \
    "$stage/share/fish/vendor_completions.d"
cp "$rayo" "$stage/bin/rayo"
# A program that renders and no more, as `make demo` begins with, has none.
"$rayo" man --out "$stage/share/man/man1" 2>/dev/null || fail "$rayo has no manual: run make build first"
"$rayo" completions bash >"$stage/share/bash-completion/completions/rayo"
"$rayo" completions zsh >"$stage/share/zsh/site-functions/_rayo"
"$rayo" completions fish >"$stage/share/fish/vendor_completions.d/rayo.fish"
find "$stage/share" -type f -exec chmod 644 {} +
# Names of functions are for who takes the program apart. Without binutils they stay.
strip "$stage/bin/rayo" 2>/dev/null || true

files=$(cd "$stage" && find . -type f | sed 's|^\./||')
for file in $files; do writable "$(dirname "$root/$file")"; done
take_back() {
    for file in $files; do rm -f "$root/$file.part"; done
    fail "could not copy to $root: what was there is as it was"
}
for file in $files; do
    mkdir -p "$(dirname "$root/$file")" && cp "$stage/$file" "$root/$file.part" || take_back
done
for file in $files; do mv -f "$root/$file.part" "$root/$file"; done
printf 'installed: %s\n' "$root/bin/rayo"
