#!/usr/bin/env bash
# Tries a clean Debian 12: a root of its own with Rust and a C compiler, and nothing else. As root, with debootstrap.
#
#     tests/clean_root.sh FOLDER [demo] [tests] [package]
#
# demo and tests are the two commands of the README, as printed there. package builds the Debian package, installs it, runs
# a rig by the command line of its unit, and removes it. Each prints its time and the disk that the root takes after it.
# The root stays in FOLDER, to be used again. Rust, with its downloaded crates, is that of this machine. The mounts end with
# this script.
set -euo pipefail
project=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
usage="usage: tests/clean_root.sh FOLDER [demo] [tests] [package]"
folder=${1:?$usage}
shift
steps=("$@")
((${#steps[@]})) || steps=(demo tests package)

if [[ -z ${RICOCHET_CLEAN_ROOT:-} ]]; then
    export RICOCHET_CLEAN_ROOT=1
    exec unshare --mount "$0" "$folder" "${steps[@]}"
fi

[[ -d $folder/usr ]] ||
    debootstrap --variant=minbase --include=gcc,libc6-dev,ca-certificates bookworm "$folder" >"$folder.log"
folder=$(cd "$folder" && pwd)
# The home of the newcomer, inside the root.
home=/srv
# The checkout as a newcomer gets it: committed files alone. What was built before stays; remove its folder target to time
# the first build.
checkout=$folder$home/ricochet
mkdir -p "$checkout"
find "$checkout" -mindepth 1 -maxdepth 1 ! -name target -exec rm -rf {} +
git -C "$project" archive HEAD | tar -x -C "$checkout"

mount -t proc proc "$folder/proc"
mount --rbind /sys "$folder/sys"
mount -t tmpfs tmpfs "$folder/dev"
for device in null zero full random urandom tty; do
    touch "$folder/dev/$device"
    mount --bind "/dev/$device" "$folder/dev/$device"
done
mkdir "$folder/dev/shm" "$folder/dev/pts"
ln -s /proc/self/fd "$folder/dev/fd"
mount -t tmpfs tmpfs "$folder/dev/shm"
mount -t tmpfs tmpfs "$folder/tmp"
for place in .cargo .rustup; do
    mkdir -p "$folder$home/$place"
done
mount --bind "${CARGO_HOME:-$HOME/.cargo}" "$folder$home/.cargo"
mount --bind "${RUSTUP_HOME:-$HOME/.rustup}" "$folder$home/.rustup"
cp /etc/resolv.conf /etc/hosts "$folder/etc/"

inside() { # COMMAND LINE
    env --chdir="$folder" -u CARGO_HOME -u RUSTUP_HOME -u CARGO_TARGET_DIR -u RICOCHET_CLEAN_ROOT -u RICOCHET_REAL_DATA \
        HOME=$home PATH=$home/.cargo/bin:/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 TMPDIR=/tmp \
        chroot "$folder" bash -c "cd $home/ricochet && $1" </dev/null
}

# Every file of the root, but the checkout, what dpkg notes, and the copies that useradd keeps of the files it changes.
listing() {
    inside 'find / -xdev -not -path "$HOME/*" -not -path "/var/lib/dpkg/*" -not -path "/var/log/*" -not -path "/etc/*-" | sort'
}

measured() { # NAME COMMAND LINE
    local began=$SECONDS
    echo "== $1: $2"
    inside "$2"
    local disk
    disk=$(du -sm --exclude="$folder$home/.*" --one-file-system "$folder" | cut -f1)
    echo "== $1: $((SECONDS - began)) s, the root takes $disk MB without Rust"
}

# The commands of the first block of the README, without their comments.
printed=$(sed -n '/^```sh$/,/^```$/p' "$project/README.md" | sed '/^```/d; s/ *#.*//' | head -n 2)
for step in "${steps[@]}"; do
    case $step in
    demo) measured demo "$(sed -n 1p <<<"$printed")" ;;
    tests) measured tests "$(sed -n 2p <<<"$printed")" ;;
    package)
        measured build 'cargo build --release && packaging/debian.sh'
        before=$(listing)
        measured install 'dpkg --install target/ricochet_*.deb'
        # The unit's command line as its user, with the folders that systemd makes.
        unit=$(sed -n 's/^ExecStart=//p' "$folder/lib/systemd/system/ricochet@.service")
        cp "$project/config/lacrosse.toml" "$folder/etc/ricochet/"
        inside 'install -d -m 700 -o ricochet /run/ricochet /var/lib/ricochet'
        measured rig "cd /var/lib/ricochet && RICOCHET_RUNTIME_DIR=/run/ricochet \
            setpriv --reuid=ricochet --regid=ricochet --clear-groups ${unit//%i/lacrosse} && ls shots"
        inside 'rm -r /run/ricochet /var/lib/ricochet/* /etc/ricochet/lacrosse.toml'
        measured remove 'dpkg --purge ricochet'
        diff <(echo "$before") <(listing)
        inside '! getent passwd ricochet'
        echo "== nothing is left"
        ;;
    *) echo "$usage" >&2 && exit 2 ;;
    esac
done
