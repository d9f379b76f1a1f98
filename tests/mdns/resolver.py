"""Looks for daemons: resolver.py silent | announced PORT PID"""

import json
import os
import signal
import sys
import time
import urllib.request

from zeroconf import IPVersion, ServiceBrowser, ServiceListener, Zeroconf

KIND = "_plenalign._tcp.local."


class Seen(ServiceListener):
    def __init__(self):
        self.there, self.gone = [], []

    def add_service(self, zeroconf, kind, name):
        self.there.append(name)

    def update_service(self, zeroconf, kind, name):
        pass

    def remove_service(self, zeroconf, kind, name):
        self.gone.append(name)


def until(what, found):
    for _ in range(100):
        if found():
            return
        time.sleep(0.1)
    raise AssertionError(f"within 10 s {what}")


zeroconf = Zeroconf(interfaces=["192.0.2.1"], ip_version=IPVersion.V4Only)
seen = Seen()
ServiceBrowser(zeroconf, KIND, seen)
if sys.argv[1] == "silent":
    time.sleep(2.5)
    assert not seen.there, seen.there
    print("- mdns: nothing is announced")
else:
    port, daemon = int(sys.argv[2]), int(sys.argv[3])
    until("nothing was announced", lambda: seen.there)
    service = zeroconf.get_service_info(KIND, seen.there[0], timeout=5000)
    assert service is not None and service.port == port, service
    assert service.parsed_addresses() == ["192.0.2.1"], service.parsed_addresses()
    said = {key.decode(): value.decode() for key, value in service.properties.items()}
    with urllib.request.urlopen(f"http://192.0.2.1:{port}/healthz") as answer:
        health = json.loads(answer.read())
    assert said == {
        "version": health["version"],
        "path": "/",
        "api": "/api/v1",
        "tls": "false",
        "bench": "simulated",
    }, said
    print(f"- mdns: announced as {service.name}")
    os.kill(daemon, signal.SIGTERM)
    until("the announcement was not taken back", lambda: seen.gone)
    print("- mdns: and taken back at the daemon's end")
zeroconf.close()
