# shellcheck shell=bash disable=SC2016,SC2034,SC2154
# The udev rules on devices that are not there: umockdev shows udev a tree of them, as they stand in devices/.

# What udev makes of a device: links and properties. device_links FILE SYSPATH
udev_makes() {
  in_root "$root" umockdev-run --device "/tmp/devices/$1.umockdev" -- udevadm test --action=add "$2" 2>&1
}

devices_have_names() {
  local said
  cp -r tests/package/devices "$root/tmp/devices"
  # Rules that udev does not understand are said when they are read.
  said=$(in_root "$root" udevadm test /sys/devices/virtual/mem/null 2>&1)
  has "udev reads the rules" "$said" 'plenalign.rules'
  is "and understands every line" "$(grep -E 'plenalign.rules:[0-9]+' <<<"$said" || true)" ""

  local usb=/sys/devices/pci0000:00/0000:00:14.0/usb1
  links() { sed -n 's/^DEVLINKS=//p' <<<"$1" | tr ' ' '\n' | sed -n 's|^/dev/plenalign/||p' | xargs; }
  said=$(udev_makes ftdi $usb/1-2/1-2:1.0/ttyUSB0/tty/ttyUSB0)
  is "an adapter with a serial number" "$(links "$said")" stage-ftdi-A50285BI
  has "is left alone by ModemManager" "$said" '^ID_MM_PORT_IGNORE=1'
  said=$(udev_makes ch340 $usb/1-3/1-3:1.0/ttyUSB1/tty/ttyUSB1)
  is "one without, by its place" "$(links "$said")" stage-ch340-at-pci-0000:00:14.0-usb-0:3:1.0
  said=$(udev_makes zaber $usb/1-4/1-4:1.0/tty/ttyACM0)
  is "a controller that is its own" "$(links "$said")" stage-zaber-104233
  said=$(udev_makes modem $usb/1-5/1-5:1.0/tty/ttyACM1)
  is "what is no stage has no name" "$(links "$said")" ""
  said=$(udev_makes ftdi $usb/1-2)
  has "its USB device stays awake" "$said" 'power/control.*on|ATTR .*power/control'
  # What it captures is here said by the device, which cannot be opened and asked.
  said=$(udev_makes camera $usb/1-6/1-6:1.0/video4linux/video0)
  is "a camera" "$(links "$said")" camera-199e-8101-12345678
  said=$(udev_makes camera $usb/1-6)
  has "it stays awake" "$said" 'power/control.*on|ATTR .*power/control'
  said=$(udev_makes modem $usb/1-5)
  is "another may sleep" "$(grep power/control <<<"$said" || true)" ""
}
