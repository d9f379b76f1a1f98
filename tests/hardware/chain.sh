# In the guest: the daemon on a hardware bench, its camera a loopback that is fed from the host, its stages a USB serial
# adapter. Ends when the host puts a file `stop` into the share.
wait_for() { until [ -e "$1" ]; do sleep 1; done; }
modprobe v4l2loopback video_nr=20 card_label="Chain camera" exclusive_caps=0 max_buffers=4 || exit 1
modprobe -a xhci_pci xhci_hcd usbserial ftdi_sio || exit 1
cp /mnt/host/plenalign /tmp/plenalign
plenalign-hardware feed 0.0.0.0:8081 /dev/video20 &
wait_for /dev/ttyUSB0
ls -l /dev/video20 /dev/ttyUSB0
export PLENALIGN_STATE_DIR=/tmp/state RUST_LOG=info
# Beyond loopback the daemon demands a token, with TLS or without.
mkdir -p "$PLENALIGN_STATE_DIR"
/tmp/plenalign token create --name chain --scope control >/mnt/host/token.part || exit 1
mv /mnt/host/token.part /mnt/host/token
(
  while ! [ -e /mnt/host/stop ]; do
    /tmp/plenalign --config /mnt/host/chain.toml serve --listen 0.0.0.0:8080 --insecure
    echo "daemon: ended with $?"
    sleep 1
  done
) &
wait_for /mnt/host/stop
exit 0
