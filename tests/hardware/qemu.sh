#!/usr/bin/env bash
# Boots target/hardware's kernel under software emulation and runs a script of target/hardware/share in it.
#
#   tests/hardware/qemu.sh SCRIPT [QEMU-ARGUMENT...]
#
# The share is the guest's /mnt/host. Ports 8080 and 8081 of the guest appear on 127.0.0.1:18080 and 18081. The guest's
# console goes to standard output. Killed after ${LIMIT:-900} seconds, for one that hangs; a kernel that crashes ends it at
# once.
set -euo pipefail
work=$(cd "$(dirname "$0")/../.." && pwd)/target/hardware
script=$1
shift
exec timeout "${LIMIT:-900}" qemu-system-x86_64 -accel tcg,thread=multi,tb-size=512 -machine q35,smm=off -cpu max \
  -smp "${CPUS:-2}" -m "${MEMORY:-2048}" -nodefaults -no-user-config -display none -no-reboot -monitor none \
  -kernel "$work/vmlinux" -initrd "$work/initrd.img" -serial stdio \
  -append "console=ttyS0 quiet oops=panic panic=-1 mitigations=off tsc=reliable no_timer_check guest.script=$script" \
  -virtfs "local,path=$work/share,mount_tag=host,security_model=none" \
  -netdev "user,id=net,restrict=on,hostfwd=tcp:127.0.0.1:18080-:8080,hostfwd=tcp:127.0.0.1:18081-:8081" \
  -device virtio-net-pci,netdev=net,romfile= -device virtio-rng-pci "$@" </dev/null
