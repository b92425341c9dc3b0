#!/usr/bin/env bash
# Prepares the virtual machine of the V4L2 tests: the distribution's kernel with its
# virtual camera (vivid), and the loop-back camera built for it.
#
#   tests/vm/prepare.sh         prints the directory; takes seconds after the first time
#
# For Debian 12 on x86-64. Fetches the lists of apt if there are none. Packages are
# downloaded and unpacked, not installed. The files needed of them (10 MB) are kept by
# version under ${XDG_CACHE_HOME:-~/.cache}/ricochet-vm. Building the loop-back module
# needs gcc, make and libelf1.
set -euo pipefail

self=$(realpath "$0")
depends() { apt-cache depends --important "$1" | sed -n "s/^ *Depends: \($2\)$/\1/p" | head -1; }
version() { apt-cache policy "$1" | sed -n 's/^ *Candidate: //p'; }

[[ -n $(version v4l2loopback-dkms) ]] || apt-get update -q >&2
image=$(depends linux-image-amd64 'linux-image-[0-9].*')
release=${image#linux-image-}
loopback=v4l2loopback-dkms
: "${release:?no Debian kernel for amd64 among the packages of this machine}"

cache=${XDG_CACHE_HOME:-$HOME/.cache}/ricochet-vm
folder=$cache/$release-$(version "$image")-loopback-$(version $loopback)
link() { ln -sfn "$(basename "$folder")" "$cache/current" && echo "$folder"; }
if [[ -e $folder/complete ]]; then
    link
    exit
fi

mkdir -p "$cache"
work=$(mktemp -d "$cache/prepare.XXXXXX")
trap 'rm -rf "$work"' EXIT
chmod 755 "$work"
cd "$work"
headers=linux-headers-$release
common=linux-headers-${release%-amd64}-common
kbuild=linux-kbuild-$(cut -d. -f1,2 <<<"$release")
# apt drops its privileges, and warns if it then cannot write to this directory.
if ! apt-get download -q "$image" "$headers" "$common" "$kbuild" $loopback >&2; then
    # Lists from before the last security update name packages that no longer exist.
    [[ ${1-} != again ]] || exit 1
    apt-get update -q >&2
    cd /
    rm -rf "$work"
    exec "$self" again
fi

mkdir kernel made
dpkg-deb --fsys-tarfile "$image"_*.deb |
    tar -x -C kernel --wildcards './boot/vmlinuz-*' './lib/modules/*/kernel/drivers/media/*'
cp kernel/boot/vmlinuz-* made/kernel

# The loop-back camera: a Kbuild of one line against the unpacked headers, whose
# makefile has one absolute path.
mkdir tools
for package in "$headers" "$common" "$kbuild" $loopback; do
    dpkg-deb --extract "$package"_*.deb tools
done
sed -i "s|/usr/src/|$work/tools/usr/src/|; s|/usr/lib/|$work/tools/usr/lib/|" \
    "tools/usr/src/$headers/Makefile"
mkdir module
cp tools/usr/src/v4l2loopback-*/*.[ch] module/
echo 'obj-m := v4l2loopback.o' >module/Kbuild
make -s -C "tools/usr/src/$headers" M="$work/module" modules >&2

# Modules in the order of their dependencies.
mkdir all
find kernel/lib/modules module -name '*.ko' -exec cp -t all {} +
needs() { tr '\0' '\n' <"all/$1.ko" | sed -n 's/^depends=//p' | tr , '\n'; }
: >made/order
visit() {
    # A module name has _ where its file may have -. A module without a file is built into the kernel.
    local file=${1//_/-} need
    [[ -e all/$file.ko ]] || file=$1
    if [[ ! -e all/$file.ko ]] || grep -qx "$file" made/order; then
        return
    fi
    for need in $(needs "$file"); do visit "$need"; done
    echo "$file" >>made/order
    strip --strip-debug -o "made/$file.ko" "all/$file.ko"
}
visit vivid
visit v4l2loopback
touch made/complete
rm -rf "$folder"
mv made "$folder"
link
