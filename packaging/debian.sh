#!/usr/bin/env bash
# Builds the Debian package: packaging/debian.sh [PROGRAM] [FOLDER]
#
# PROGRAM is a built program, target/release/ricochet by default. The package is written into FOLDER, target by default.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
program=${1:-$root/target/release/ricochet}
folder=${2:-$root/target}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$root/Cargo.toml" | head -n 1)
architecture=$(dpkg --print-architecture)
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT

install -D -m 755 "$program" "$stage/usr/bin/ricochet"
strip "$stage/usr/bin/ricochet"
"$program" man --output "$stage/usr/share/man/man1"
gzip -9n "$stage"/usr/share/man/man1/*.1
completions=$stage/usr/share
mkdir -p "$completions"/bash-completion/completions "$completions"/zsh/vendor-completions "$completions"/fish/vendor_completions.d
"$program" completions bash >"$completions/bash-completion/completions/ricochet"
"$program" completions zsh >"$completions/zsh/vendor-completions/_ricochet"
"$program" completions fish >"$completions/fish/vendor_completions.d/ricochet.fish"
mkdir -p "$stage/lib/systemd/system"
sed 's#/usr/local/bin/#/usr/bin/#' "$root/docs/systemd/ricochet@.service" >"$stage/lib/systemd/system/ricochet@.service"
install -D -m 644 "$root/packaging/70-ricochet.rules" "$stage/lib/udev/rules.d/70-ricochet.rules"
install -D -m 644 "$root/packaging/50-ricochet.conf" "$stage/usr/lib/sysctl.d/50-ricochet.conf"
for file in README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE; do
    install -D -m 644 "$root/$file" "$stage/usr/share/doc/ricochet/$file"
done
for file in "$root"/config/*.toml; do
    install -D -m 644 "$file" "$stage/usr/share/doc/ricochet/examples/${file##*/}"
done
mkdir -p "$stage/etc/ricochet" "$stage/DEBIAN"

cat >"$stage/DEBIAN/control" <<CONTROL
Package: ricochet
Version: $version
Architecture: $architecture
Maintainer: The ricochet developers <ricochet@localhost>
Section: science
Priority: optional
Depends: libc6 (>= 2.36), libgcc-s1
Recommends: libaravis-0.8-0, ffmpeg
Installed-Size: $(du -sk "$stage" | cut -f1)
Description: live measurement of impacts with a high-speed camera
 Films an impact and measures it while it happens: position, velocity, spin,
 contact times and restitution of balls, rods and other bodies, each with its
 uncertainty, by digital image correlation.
CONTROL
cat >"$stage/DEBIAN/postinst" <<'POSTINST'
#!/bin/sh
# The user of the rigs that run as services.
set -e
if [ "$1" = configure ] && [ -z "$DPKG_ROOT" ] && ! getent passwd ricochet >/dev/null; then
    useradd --system --groups video --home-dir /var/lib/ricochet --shell /usr/sbin/nologin ricochet
fi
POSTINST
cat >"$stage/DEBIAN/postrm" <<'POSTRM'
#!/bin/sh
# Recordings stay: only empty folders go.
set -e
if [ "$1" = purge ]; then
    for folder in /var/lib/ricochet /etc/ricochet; do
        [ ! -d "$DPKG_ROOT$folder" ] || rmdir --ignore-fail-on-non-empty "$DPKG_ROOT$folder"
    done
    [ -n "$DPKG_ROOT" ] || ! getent passwd ricochet >/dev/null || userdel ricochet
fi
POSTRM
chmod 755 "$stage"/DEBIAN/post*
mkdir -p "$folder"
dpkg-deb --root-owner-group --build "$stage" "$folder/ricochet_${version}_$architecture.deb"
