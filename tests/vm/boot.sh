#!/usr/bin/env bash
# Boots the virtual machine that `prepare.sh` has prepared and runs a program in it.
#
#   tests/vm/boot.sh [--with FILE] PROGRAM [ARGUMENT...]     prints its console
#
# The program runs unchanged, with the shared libraries of this machine, once the
# virtual cameras exist: vivid as the first video device, the loop-back camera as
# /dev/video10. FILE is another program that it starts, copied to the same path.
# The last line is "RESULT" and the exit code. KVM is not needed. VM_LIMIT_S (240)
# ends a machine that hangs. Needs qemu-system-x86_64, busybox (static) and cpio.
set -euo pipefail

cache=${XDG_CACHE_HOME:-$HOME/.cache}/ricochet-vm/current
other=
if [[ $1 == --with ]]; then
    other=$(realpath "$2")
    shift 2
fi
program=$1
shift
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

tree=$work/tree
mkdir -p "$tree"/{bin,dev,proc,sys,run,tmp,modules,lib64}
cp "$(command -v busybox)" "$tree/bin/busybox"
cp "$cache"/*.ko "$tree/modules/"
strip -o "$tree/program" "$program"
if [[ -n $other ]]; then
    mkdir -p "$tree/$(dirname "$other")"
    strip -o "$tree/$other" "$other"
fi
# The machine has no loader cache, so that all libraries go to one directory.
ldd "$program" ${other:+"$other"} | sed -n 's/.*\(=> \|^\t\)\(\/[^ ]*\) (.*/\2/p' | while read -r library; do
    cp -L "$library" "$tree/lib64/"
done

{
    echo '#!/bin/busybox sh'
    echo 'export PATH=/bin LD_LIBRARY_PATH=/lib64 HOME=/run TMPDIR=/run RUST_BACKTRACE=0'
    echo '/bin/busybox --install -s /bin'
    echo 'mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t devtmpfs dev /dev; mount -t tmpfs run /run'
    echo 'mkdir -p /dev/shm; mount -t tmpfs shm /dev/shm'
    # Kernel messages on the console would break lines of output.
    echo 'echo 1 >/proc/sys/kernel/printk'
    while read -r module; do
        case $module in
        vivid) options='n_devs=1 node_types=0x1' ;;
        v4l2loopback) options='video_nr=10 max_buffers=16 card_label=loopback' ;;
        *) options='' ;;
        esac
        echo "insmod /modules/$module.ko $options"
    done <"$cache/order"
    printf '/program'
    printf ' %q' "$@"
    printf '\n'
    # shellcheck disable=SC2016
    echo 'code=$?; echo; echo "RESULT $code"; poweroff -f'
} >"$tree/init"
chmod +x "$tree/init"

(cd "$tree" && find . | cpio --quiet -o -H newc -R 0:0) >"$work/initrd"
timeout "${VM_LIMIT_S:-240}" qemu-system-x86_64 -machine q35 -accel tcg,thread=multi -cpu max -m 768 -smp 1 \
    -nodefaults -no-user-config -nographic -no-reboot -serial stdio \
    -kernel "$cache/kernel" -initrd "$work/initrd" -append 'console=ttyS0 quiet panic=-1' </dev/null | tr -d '\r'
