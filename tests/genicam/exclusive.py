"""Another program, which has a camera for itself alone until its input ends: exclusive.py ADDRESS"""

import select
import sys

import gvcp

# A camera lets go of a program that is silent for some seconds.
HEARTBEAT_S = 0.5

camera = gvcp.Client(sys.argv[1])
camera.write_register(gvcp.CONTROL_PRIVILEGE, gvcp.EXCLUSIVE)
assert camera.register(gvcp.CONTROL_PRIVILEGE) == gvcp.EXCLUSIVE
print("held", flush=True)
while not select.select([sys.stdin], [], [], HEARTBEAT_S)[0]:
    assert camera.register(gvcp.CONTROL_PRIVILEGE) == gvcp.EXCLUSIVE, "it was taken away"
camera.write_register(gvcp.CONTROL_PRIVILEGE, 0)
