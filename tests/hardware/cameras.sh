# In the guest: the virtual cameras, then the tests. Numbers as tests/hardware/main.rs expects them: 10 a webcam, 11 an
# HDMI grabber (crops and scales), 20 and 21 loopbacks. USB cameras are plugged into a host controller of no hardware.
modprobe vivid n_devs=2 node_types=0x1,0x1 num_inputs=1,1 input_types=0x0,0x3 vid_cap_nr=10,11 no_error_inj=0,0 || exit 1
modprobe v4l2loopback video_nr=20,21 card_label="Loop A,Loop B" exclusive_caps=0,1 max_buffers=4 || exit 1
modprobe vhci_hcd || exit 1
for number in 10 11 20 21; do
  until [ -e /dev/video$number ]; do sleep 1; done
done
ls /dev/video*
# shellcheck disable=SC2046
plenalign-hardware $(cat /mnt/host/filters)
